"""Overlays: what is drawn where, how far off it is said to be, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.ndimage import binary_dilation, binary_erosion
from scipy.spatial import Delaunay

from graspcast.bop.meshes import Mesh
from graspcast.pose.transforms import rotation_from_vector, transform, transform_points
from graspcast.rendering.drawing import GUIDE
from graspcast.rendering.overlay import draw_overlay

SIDE = 128
K = np.array([[150.0, 0, 63.5], [0, 150.0, 63.5], [0, 0, 1.0]])
FAR_OFF = transform(np.eye(3), np.array([0.02, 0.03, 0.0]))


def cube() -> tuple[Mesh, np.ndarray]:
    made = trimesh.creation.box(extents=(0.1, 0.08, 0.12))
    mesh = Mesh(np.asarray(made.vertices), np.asarray(made.faces))
    return mesh, np.tile(np.array([220, 40, 40], dtype=np.uint8), (len(mesh.vertices), 1))


def noise(height: int = SIDE, width: int = SIDE) -> np.ndarray:
    return np.random.default_rng(0).integers(60, 120, (height, width, 3), dtype=np.uint8)


def near(x: float = 0.0, y: float = 0.0, z: float = 0.2) -> np.ndarray:
    """So near that the whole image is in the picture, at its own scale."""
    return transform(rotation_from_vector(np.array([0.5, 0.7, 0.2])), np.array([x, y, z]))


def inside(mesh: Mesh, cam_T_obj: np.ndarray, intrinsics: np.ndarray = K) -> np.ndarray:
    """The pixels in the convex hull of the projected vertices."""
    pixels = transform_points(cam_T_obj, mesh.vertices) @ intrinsics.T
    hull = Delaunay(pixels[:, :2] / pixels[:, 2:])
    v, u = np.mgrid[:SIDE, :SIDE]
    return (hull.find_simplex(np.stack([u, v], axis=-1).reshape(-1, 2)) >= 0).reshape(SIDE, SIDE)


def test_the_estimate_is_green_and_the_rest_is_the_image() -> None:
    (mesh, colours), image = cube(), noise()
    out = draw_overlay(image, K, mesh, colours, near(), size=SIDE)
    covered = inside(mesh, near())
    assert 3000 < covered.sum() < 12000
    well, around = binary_erosion(covered, iterations=2), binary_dilation(covered, iterations=4)
    np.testing.assert_array_equal(out[~around], image[~around])
    green = (out[..., 1] > out[..., 0] + 20) & (out[..., 1] > out[..., 2] + 20)
    assert green[well].mean() > 0.85
    # Translucent: the noise is seen through it.
    assert np.corrcoef(out[well][:, 0], image[well][:, 0])[0, 1] > 0.3
    outline = binary_dilation(covered, iterations=2) & ~covered
    assert out[outline].astype(int)[:, 1].mean() > 150


def test_the_true_pose_is_solid_and_in_its_colours() -> None:
    (mesh, colours), image = cube(), noise()
    true, est = near(-0.02), near(0.02, 0.01)
    out = draw_overlay(image, K, mesh, colours, est, true, size=SIDE)
    alone = inside(mesh, true) & ~binary_dilation(inside(mesh, est), iterations=4)
    alone = binary_erosion(alone, iterations=2)
    assert alone.sum() > 100
    assert (out[alone].astype(int)[:, 0] > 2 * out[alone][:, 1]).all()
    both = binary_erosion(inside(mesh, true) & inside(mesh, est), iterations=3)
    plain = draw_overlay(image, K, mesh, colours, est, size=SIDE)
    # The true one hides the image behind it, and shines through the estimate.
    assert out[both][:, 0].astype(int).mean() > plain[both][:, 0].astype(int).mean() + 20
    assert out[both].astype(int)[:, 1].mean() > 60


def gradient(height: int, width: int) -> np.ndarray:
    """Red tells the column and green the row, in shares of 255."""
    v, u = np.mgrid[:height, :width] + 0.5
    return np.rint(np.stack([255 * u / width, 255 * v / height, 0 * u], axis=-1)).astype(np.uint8)


@pytest.mark.parametrize(("height", "width"), [(480, 640), (640, 480)])
@pytest.mark.parametrize("at", [(0.0, 0.0), (0.3, 0.25), (-0.34, -0.28)])
def test_the_picture_is_a_square_about_both(
    height: int, width: int, at: tuple[float, float]
) -> None:
    mesh, colours = cube()
    colours[:] = [0, 0, 250]
    intrinsics = np.array([[600.0, 0, width / 2], [0, 600.0, height / 2], [0, 0, 1]])
    pose = transform(np.eye(3), np.array([*at, 0.8]))
    poses = pose, pose @ FAR_OFF
    out = draw_overlay(gradient(height, width), intrinsics, mesh, colours, *poses, size=200)
    size = np.array([width, height])
    low, high = out[0, 0, :2] / 255 * size, out[-1, -1, :2] / 255 * size
    # As wide as high, and the least of it: a byte tells the place to three pixels.
    assert high - low == pytest.approx(np.full(2, (high - low).mean()), abs=4)
    corners = [transform_points(p, mesh.vertices) @ intrinsics.T for p in poses]
    seen = [np.clip(c[:, :2] / c[:, 2:], 0, size) for c in corners]
    both = np.concatenate(seen)
    assert (both > low - 3).all() and (both < high + 3).all()
    assert (high - low).max() < 1.4 * np.ptp(both, axis=0).max()
    green = np.argwhere((out[..., 1] > 200) & (out[..., 0] < 60))[:, ::-1]
    drawn = low + green / 200 * (high - low)
    compared = 0
    for end in (np.min, np.max):
        there, reached = end(seen[0], axis=0), end(drawn, axis=0)
        # At the image's border there is no outline.
        within = (there > 10) & (there < size - 10)
        assert reached[within] == pytest.approx(there[within], abs=6)
        compared += within.sum()
    assert compared >= 2


def test_beyond_the_image_the_picture_is_white() -> None:
    mesh, colours = cube()
    level = K.copy()
    level[1, 2] = 29.5
    out = draw_overlay(gradient(60, 300), level, mesh, colours, near(0.05, 0.0, 0.35), size=100)
    white = (out == 255).all(axis=-1)
    assert white[:4].all(axis=1).any() and white[-4:].all(axis=1).any()
    assert not white[45:55].any()


def test_wild_estimates_are_drawn_as_far_as_they_are_seen() -> None:
    (mesh, colours), image = cube(), noise(96, 160)
    for pose in (near(z=-0.5), near(5.0), near(z=0.01), near(z=50.0)):
        out = draw_overlay(image, K, mesh, colours, pose, near(z=0.6), size=64)
        assert out.shape == (64, 64, 3)
        assert (out[..., 0] > out[..., 1].astype(int) + 40).any() or np.linalg.norm(pose) < 2


def test_a_guide_is_an_outline_around_its_pose() -> None:
    (mesh, colours), image = cube(), noise()
    est, guide = near(-0.02), near(0.02, 0.015)
    out = draw_overlay(image, K, mesh, colours, est, guides=[guide], size=SIDE)
    plain = draw_overlay(image, K, mesh, colours, est, size=SIDE)
    changed = (out != plain).any(axis=2)
    covered = inside(mesh, guide)
    ring = binary_dilation(covered, iterations=3) & ~binary_erosion(covered, iterations=2)
    assert changed.sum() > 200 and not (changed & ~ring).any()
    parts = out.astype(int)
    # Red and blue, as no pixel of the noise or of the estimate is.
    magenta = (parts[..., [0, 2]] > parts[..., 1:2] + 62).all(axis=2)
    outline = binary_dilation(covered) & ~covered
    assert magenta[outline].mean() > 0.8
    assert not magenta[~ring].any()
    # The estimate keeps its own outline elsewhere.
    green = parts[..., 1] > parts[..., [0, 2]].max(axis=2) + 50
    own = binary_dilation(inside(mesh, est)) & ~inside(mesh, est) & ~ring
    assert green[own].mean() > 0.8


def test_the_picture_has_room_for_the_guide() -> None:
    (mesh, colours), image = cube(), noise(480, 640)
    intrinsics = np.array([[600.0, 0, 320], [0, 600.0, 240], [0, 0, 1]])
    est, guide = near(0.0, z=1.2), near(0.15, z=1.2)
    out = draw_overlay(image, intrinsics, mesh, colours, est, guides=[guide], size=200)
    magenta = np.argwhere(np.abs(out.astype(int) - GUIDE).max(axis=2) < 60)
    assert magenta[:, 1].max() > 170 and magenta[:, 1].max() < 198
