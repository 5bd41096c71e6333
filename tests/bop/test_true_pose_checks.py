"""Ground truth that cannot be that of objects before a camera is named."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.bop.true_pose_checks import check_outlines, check_true_poses
from graspcast.errors import FormatError
from poses import random_poses

POSES = random_poses(8, 1)
INSTANCES = np.stack([np.arange(8), np.full(8, 1)], axis=1)
UNKNOWN = np.full(8, np.nan)


def check(R: np.ndarray, t: np.ndarray, seen: np.ndarray = UNKNOWN, size: float = 0.15) -> str:
    try:
        check_true_poses("scene_gt.json", INSTANCES, R, t, seen, {1: size})
    except FormatError as error:
        return str(error)
    return ""


R, T = POSES[:, :3, :3], POSES[:, :3, 3]


def test_poses_before_the_camera_pass() -> None:
    assert check(R, T) == ""
    check_true_poses("scene_gt.json", INSTANCES[:0], R[:0], T[:0], UNKNOWN[:0])


@pytest.mark.parametrize(
    ("factor", "says"), [(1e-3, "in metres"), (1e-1, "in centimetres"), (1 / 25.4, "in inches")]
)
def test_another_unit_is_named(factor: float, says: str) -> None:
    said = check(R, factor * T)
    assert "scene_gt.json: the median distance of cam_t_m2c is" in said
    assert "an object 150 mm across should be 150 mm to 7.50 m away" in said
    assert says in said


def test_mirrored_and_scaled_matrices_are_named() -> None:
    mirror = np.where(np.arange(8)[:, None, None] == 3, R @ np.diag([1.0, 1.0, -1.0]), R)
    assert "image 3, object 1: cam_R_m2c is 2 away" in check(mirror, T)
    assert "it has a mirrored rotation" in check(mirror, T)
    assert "a rotation scaled by 1.5" in check(1.5 * R, T)


def test_objects_behind_the_camera_are_named_unless_they_are_few_and_unseen() -> None:
    opengl = T * [1, -1, -1]
    assert "image 0, object 1: the object is behind the camera" in check(R, opengl)
    assert "8 of 8 here; BOP's camera looks along +z" in check(R, opengl)
    one = np.where(np.arange(8)[:, None] == 2, opengl, T)
    assert check(R, one) == ""
    assert check(R, one, np.zeros(8)) == ""
    assert "image 2, object 1: the object is behind the camera" in check(R, one, np.full(8, 0.3))


def test_outlines_are_those_of_the_objects_where_all_is_known() -> None:
    keys = np.stack([np.ones(8, dtype=int), np.arange(8), np.ones(8, dtype=int)], axis=1)
    boxes = np.concatenate([np.zeros((8, 2)), np.full((8, 2), 50.0)], axis=1)

    def check_depth(depth: float, boxes: np.ndarray = boxes, focal: float = 600.0) -> None:
        check_outlines(
            "gt",
            keys,
            np.full(8, depth),
            np.full(8, 0.9),
            boxes,
            diameters_m={1: 0.1},
            focal_px=lambda scene_id, im_id: focal,
        )

    check_depth(1.0)
    with pytest.raises(FormatError, match=r"gt: the median depth .* is 100 mm, but boxes of 50"):
        check_depth(0.1)
    check_depth(0.1, focal=np.nan)
    check_depth(0.1, np.full((8, 4), np.nan))
    check_depth(0.1, np.full((8, 4), -1.0))
