"""Outlines: where they are, which way their normals point, and why there is none."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from graspcast.bop.meshes import Mesh
from graspcast.pose.transforms import transform
from graspcast.rendering.outline import REACH, Outline, outline_of

K = np.array([[300.0, 0, 99.5], [0, 300.0, 79.5], [0, 0, 1.0]])
WIDTH, HEIGHT = 200, 160


def ball(radius: float = 0.05) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def at(x: float = 0.0, y: float = 0.0, z: float = 0.5) -> np.ndarray:
    return transform(np.eye(3), np.array([x, y, z]))


def grey(height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    return np.full((height, width, 3), 120, dtype=np.uint8)


def found(pose: np.ndarray, *, scale: int = 1, mesh: Mesh | None = None) -> Outline:
    intrinsics = np.diag([scale, scale, 1.0]) @ K
    intrinsics[:2, 2] += (scale - 1) / 2
    image = grey(HEIGHT * scale, WIDTH * scale)
    out = outline_of(image, intrinsics, mesh or ball(), pose)
    assert isinstance(out, Outline)
    return out


def test_the_outline_of_a_ball_is_a_circle_with_normals_away_from_its_centre() -> None:
    out = found(at())
    centre = out.points.mean(axis=0)
    radius = np.linalg.norm(out.points - centre, axis=1)
    # 300 px at a distance at which the rays touch the ball
    np.testing.assert_allclose(radius, 300 * 0.05 / np.sqrt(0.5**2 - 0.05**2), atol=1.0)
    away = (out.points - centre) / radius[:, None]
    assert (np.sum(away * out.normals, axis=1) > 0.9).all()
    np.testing.assert_allclose(np.linalg.norm(out.normals, axis=1), 1, atol=1e-9)
    assert out.inside == 1


def test_a_larger_image_makes_no_longer_an_outline_than_160_pixels() -> None:
    for scale in (4, 12):
        span = np.ptp(found(at(), scale=scale).points, axis=0)
        assert 150 < span.max() <= 162


def test_the_border_of_the_image_is_no_outline() -> None:
    out = found(at(x=-0.15))  # the left half of the ball is outside
    assert 0.2 < out.inside < 0.8
    assert len(out.points) < 0.7 * len(found(at()).points)
    # Where the border cuts the ball, normals would point to the left.
    assert (out.normals[:, 0] > -0.3).all()


def test_a_grey_image_has_no_gradients() -> None:
    out = found(at())
    assert out.total.max() < 1e-9
    assert out.profiles.shape == (len(out.points), 2 * REACH + 1, 3)
    assert np.ptp(out.profiles[..., 0]) < 1e-5


@pytest.mark.parametrize(
    ("pose", "reason"),
    [
        (at(z=-0.5), "the pose lies behind the camera"),
        (at(x=3.0), "outside the image"),
        (at(z=15.0), "only 4 points|too few to judge"),
        (at(z=0.055), "too few to judge"),  # fills the image
        (np.full((4, 4), np.nan), "the pose holds numbers that are not finite"),
        (np.eye(4), "placeholder"),
    ],
)
def test_where_there_is_no_outline_the_reason_is_told(pose: np.ndarray, reason: str) -> None:
    out = outline_of(grey(), K, ball(), pose)
    assert isinstance(out, str)
    assert any(part in out for part in reason.split("|"))


def test_a_point_cloud_has_no_outline() -> None:
    cloud = Mesh(ball().vertices, np.empty((0, 3), dtype=np.int64))
    assert "no triangles" in str(outline_of(grey(), K, cloud, at()))


def test_an_object_that_reaches_behind_the_camera_is_drawn_where_it_is_seen() -> None:
    rod = trimesh.creation.box(extents=(0.02, 0.02, 1.0))
    mesh = Mesh(np.asarray(rod.vertices), np.asarray(rod.faces))
    out = outline_of(grey(), K, mesh, at(x=0.02, z=0.3))  # from -0.2 to 0.8 m
    assert isinstance(out, Outline)
    assert out.inside <= 0.5


@pytest.mark.parametrize("size", [(1, 1), (2, 40), (40, 1)])
def test_tiny_images_have_no_outline(size: tuple[int, int]) -> None:
    assert isinstance(outline_of(grey(*size), K, ball(), at(x=-0.15, y=-0.12)), str)
