"""Rendered images: ground truth, depth, masks and colours agree with the meshes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from graspcast.pose.transforms import invert, transform_points
from graspcast.rendering.synthetic.camera import INTRINSICS, random_view
from graspcast.rendering.synthetic.dataset import read_models
from graspcast.rendering.synthetic.renderer import Frame, Renderer


@pytest.fixture(params=range(4))
def seen(renderer: Renderer, request: pytest.FixtureRequest) -> tuple[Frame, list[np.ndarray]]:
    """A frame of a new table, and the whole silhouette of each object."""
    rng = np.random.default_rng(request.param)
    renderer.tabletop.lay_out(rng)
    renderer.new_layout()
    view = random_view(rng, renderer.tabletop.poses()[renderer.tabletop.present, :3, 3].mean(0))
    whole = [renderer.silhouette(view, k) for k in range(3)]
    return renderer.frame(view), whole


def test_what_each_pixel_shows_lies_on_the_object_where_the_ground_truth_says(
    seen: tuple[Frame, list[np.ndarray]], models: Path
) -> None:
    frame, _ = seen
    for k, mesh in enumerate(read_models(models).values()):
        rows, columns = np.nonzero(frame.label == k)
        if not len(rows):
            continue
        rays = np.stack([columns, rows, np.ones(len(rows))], axis=-1) @ np.linalg.inv(INTRINSICS).T
        points = rays * frame.depth_m[rows, columns][:, None]
        points = transform_points(invert(frame.cam_T_obj[k]), points)
        corners = mesh.vertices[mesh.faces]
        grid = np.array([[a, b, 6 - a - b] for a in range(7) for b in range(7 - a)]) / 6
        surface = np.einsum("gk,fkj->gfj", grid, corners).reshape(-1, 3)
        distance = cKDTree(surface).query(points)[0]
        # A sixth of a 10 mm triangle is between two points of the surface.
        assert np.median(distance) < 0.001 and distance.max() < 0.003


def test_the_mesh_projects_into_the_silhouette_and_spans_it(
    seen: tuple[Frame, list[np.ndarray]], renderer: Renderer, models: Path
) -> None:
    frame, whole = seen
    for k, mesh in enumerate(read_models(models).values()):
        if not renderer.tabletop.present[k]:
            continue
        pixels = transform_points(frame.cam_T_obj[k], mesh.vertices) @ INTRINSICS.T
        pixels = pixels[:, :2] / pixels[:, 2:] + [320, 240]
        rows, columns = np.nonzero(whole[k])
        spans = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
        wanted = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
        np.testing.assert_allclose(spans, wanted, atol=1.2)
        # The pixels' middles are inside, so on the average they are half a pixel further in.
        np.testing.assert_allclose(spans[:2] - wanted[:2], 0.5, atol=0.7)
        grown = binary_dilation(whole[k], iterations=1)
        column, row = np.rint(pixels).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < 1280) & (row < 960)
        assert grown[row[inside], column[inside]].mean() > 0.999


def test_what_is_visible_is_part_of_the_silhouette(
    seen: tuple[Frame, list[np.ndarray]],
) -> None:
    frame, whole = seen
    for k, mask in enumerate(whole):
        assert not ((frame.label == k) & ~mask[240:720, 320:960]).sum() > 2


def test_colours_are_those_of_the_mesh(renderer: Renderer, models: Path) -> None:
    # The colours are the place in the box, so the picture tells places, up to the light.
    rng = np.random.default_rng(0)
    renderer.tabletop.lay_out(rng)
    renderer.new_layout()
    frame = renderer.frame(random_view(rng, np.array([0.0, 0.0, 0.05])))
    for k, mesh in enumerate(read_models(models).values()):
        rows, columns = np.nonzero(frame.label == k)
        if len(rows) < 200:
            continue
        rays = np.stack([columns, rows, np.ones(len(rows))], axis=-1) @ np.linalg.inv(INTRINSICS).T
        points = rays * frame.depth_m[rows, columns][:, None]
        points = transform_points(invert(frame.cam_T_obj[k]), points)
        place = (points - mesh.vertices.min(0)) / np.ptp(mesh.vertices, 0)
        shown = frame.rgb[rows, columns].astype(float)
        # Light of nearly one colour scales all three alike, so their shares stay.
        expected = place / place.sum(axis=1, keepdims=True)
        share = shown / shown.sum(axis=1, keepdims=True)
        bright = (shown.sum(axis=1) > 60) & (shown.max(axis=1) < 250)
        assert np.abs(expected - share)[bright].mean() < 0.05
