"""One object from two sides: what is drawn where."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from graspcast.bop.meshes import Mesh
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.rendering.two_sides import DrawnPose, Side, draw_side, two_sides

K = np.array([[300.0, 0, 127.5], [0, 300.0, 127.5], [0, 0, 1.0]])
RED, GREEN = (250, 10, 10), (10, 200, 10)
AT = transform(np.eye(3), np.array([0.0, 0.0, 0.5]))
ALONG = np.diag([0.003, 0.003, 0.02]) ** 2
SIDEWAYS = transform(
    rotation_from_vector(np.array([0.0, -np.pi / 2, 0.0])), np.array([0.5, 0.0, 0.5])
)
"""A camera from the right: the first one's ray is across its own."""


def cube() -> Mesh:
    made = trimesh.creation.box(extents=(0.1, 0.1, 0.1))
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def side(world_T_cam: np.ndarray) -> Side:
    return Side("here", np.full((256, 256, 3), 128, dtype=np.uint8), K, world_T_cam)


def covered(picture: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    return np.abs(picture.astype(int) - colour).max(axis=2) < 40


def extent(mask: np.ndarray) -> np.ndarray:
    """Width and height of what is covered, pixels."""
    rows, columns = np.nonzero(mask)
    return np.array([np.ptp(columns), np.ptp(rows)])


def test_uncertainty_along_a_ray_is_seen_from_the_side() -> None:
    mesh = Mesh(cube().vertices * 0.001, cube().faces)
    near = DrawnPose("a", RED, AT, ALONG)
    front = extent(covered(draw_side(side(np.eye(4)), mesh, [near]), RED))
    beside = extent(covered(draw_side(side(SIDEWAYS), mesh, [near]), RED))
    assert front[0] == pytest.approx(front[1], abs=4)
    assert beside[0] > 4 * beside[1]
    # Two standard deviations to each side, 0.08 m at 0.5 m of distance, of a square of 48 pixels.
    assert beside[0] == pytest.approx(0.08 / 0.5 * 300 * 420 / 48, rel=0.05)


def test_the_outline_is_around_the_pose() -> None:
    mesh = cube()
    picture = draw_side(side(np.eye(4)), mesh, [DrawnPose("a", RED, AT)], 256)
    mask = covered(picture, RED)
    width, height = extent(mask)
    # The square is 1.25 times the object.
    assert width == pytest.approx(256 / 1.25, abs=8) and height == pytest.approx(width, abs=2)
    assert not mask[100:156, 100:156].any()


def test_a_sheet_has_both_sides_and_a_legend() -> None:
    poses = [DrawnPose("a", RED, AT, ALONG), DrawnPose("b", GREEN, AT, ALONG / 9)]
    sides = [side(np.eye(4)), side(SIDEWAYS)]
    sheet = np.asarray(two_sides(sides, cube(), poses, "what it is", 200))
    assert sheet.shape[1] == 410 and sheet.shape[0] > 250
    for colour in (RED, GREEN):
        mask = covered(sheet, colour)
        assert mask[24:224, :200].any() and mask[24:224, 210:].any() and mask[226:, :40].any()
    alone = np.asarray(two_sides(sides, cube(), poses[:1], size=200))
    assert not covered(alone, GREEN).any()
    assert alone.shape[0] < sheet.shape[0]
