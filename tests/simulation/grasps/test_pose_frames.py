"""Frames of grasp poses, checked by simulation."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy import ndarray

from bricks import brick, from_top
from graspcast.errors import InputError, MismatchError
from graspcast.pose.transforms import invert
from graspcast.simulation.grasps.pose_frames import PoseFrame, check_pose_frame
from graspcast.simulation.grasps.trial_pool import TrialPool
from graspcast.simulation.grippers import load_gripper

GOOD = np.array([from_top(depth) for depth in (0.015, 0.02, 0.025)])


@cache
def _pool() -> TrialPool:
    return TrialPool(brick(), load_gripper("parallel"), workers=1)


def _graspgen(grasps: ndarray) -> ndarray:
    """The origin of the Franka hand is 103.4 mm behind its tool centre point."""
    out = grasps.copy()
    out[:, :3, 3] -= 0.1034 * grasps[:, :3, 2]
    return out


def _in_base_frame(grasps: ndarray) -> ndarray:
    """The Franka hand's fingers close along y of its base."""
    out = _graspgen(grasps)
    x, y = out[:, :3, 0].copy(), out[:, :3, 1].copy()
    out[:, :3, 0], out[:, :3, 1] = -y, x
    return out


def _along_y(grasps: ndarray) -> ndarray:
    out = grasps.copy()
    out[:, :3, 0], out[:, :3, 1] = -grasps[:, :3, 1], grasps[:, :3, 0]
    return out


def _from_the_side() -> ndarray:
    """Grasps along -y; unlike that of a hand from above, the inverse of such a pose differs."""
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    out = np.array([pose, pose, pose])
    out[:, 1, 3] = 0.045 - np.array([0.015, 0.02, 0.025])
    out[:, 2, 3] = 0.015
    return out


SIDE = _from_the_side()


def _millimetres(grasps: ndarray) -> ndarray:
    out = grasps.copy()
    out[:, :3, 3] *= 1e3
    return out


WRITTEN = {
    "tcp": (GOOD, PoseFrame()),
    "graspgen": (_graspgen(GOOD), PoseFrame("graspgen")),
    "base": (_in_base_frame(GOOD), PoseFrame("base")),
    "along y": (_along_y(GOOD), PoseFrame(closing="y")),
    "millimetres": (_millimetres(GOOD), PoseFrame(unit="mm")),
    "backwards": (GOOD @ np.diag([1.0, -1, -1, 1]), PoseFrame(backwards=True)),
    "inverted": (invert(_graspgen(SIDE)), PoseFrame("graspgen", inverted=True)),
}


@pytest.mark.parametrize("how", WRITTEN)
def test_each_frame_is_read(how: str) -> None:
    poses, frame = WRITTEN[how]
    gripper = load_gripper("parallel")
    read, meant = frame.obj_T_grasp(poses, gripper), SIDE if how == "inverted" else GOOD
    assert np.allclose(read[:, :3, 3], meant[:, :3, 3], atol=1e-3)
    assert np.allclose(read[:, :3, 2], meant[:, :3, 2])
    assert np.allclose(np.abs(np.einsum("nij,nij->nj", read[:, :3, :3], meant[:, :3, :3])), 1)
    assert check_pose_frame(_pool(), poses, frame) == (3, 3)


@pytest.mark.parametrize(
    ("how", "said", "parameters"),
    [
        ("graspgen", "none of 3 grasps touches .* 3 hold: .*frame graspgen", ("frame",)),
        ("base", "read as poses of the gripper's base frame in metres, 3 hold", ("frame",)),
        ("along y", "closing along y, 3 hold", ("closing",)),
        ("millimetres", "in millimetres, 3 hold", ("unit",)),
        ("backwards", "z pointing back to the palm, 3 hold; convert them", ()),
        ("inverted", "inverted.*3 hold; convert them", ()),
    ],
)
def test_a_wrong_frame_is_found_out(how: str, said: str, parameters: tuple[str, ...]) -> None:
    poses, _ = WRITTEN[how]
    with pytest.raises(MismatchError, match=said) as raised:
        check_pose_frame(_pool(), poses, PoseFrame("graspgen" if how == "inverted" else "tcp"))
    assert raised.value.parameters == parameters


def test_no_closing_axis_is_stated_of_poses_of_the_base() -> None:
    with pytest.raises(InputError, match="leave out the closing axis"):
        PoseFrame("base", closing="y")


def test_grasps_of_something_else() -> None:
    away = GOOD.copy()
    away[:, 0, 3] += 0.4
    with pytest.raises(MismatchError, match=r"none of 3 grasps touches .* are they of this object"):
        check_pose_frame(_pool(), away, PoseFrame())


def test_metres_read_as_millimetres() -> None:
    # All hands would be at the box's middle, where some hold it.
    said = r"tool centre point in metres, 3 hold: say so, if that is what they are \(unit m\)"
    with pytest.raises(MismatchError, match=said) as raised:
        check_pose_frame(_pool(), GOOD, PoseFrame(unit="mm"))
    assert raised.value.parameters == ("unit",)
