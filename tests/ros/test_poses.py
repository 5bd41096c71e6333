import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ros_messages as ros
from graspcast.pose.transforms import rotation_from_vector
from graspcast.ros.poses import (
    PoseMessageError,
    frame_name,
    matrix_of,
    orientation_of,
    seconds,
    stamp_of,
)

UNIT = ros.Message(x=0.0, y=0.0, z=0.0, w=1.0)


def test_a_quaternion_is_xyzw_and_positions_are_metres():
    half = np.sqrt(0.5)
    turned = matrix_of(ros.vector((1, 2, 3)), ros.Message(x=0, y=0, z=half, w=half))
    expected = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    assert np.allclose(turned, expected)


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_orientations_come_back(turn):
    rotation = rotation_from_vector(np.array(turn))
    pose = np.eye(4)
    pose[:3, :3] = rotation
    x, y, z, w = orientation_of(pose)
    back = matrix_of(ros.vector((0, 0, 0)), ros.Message(x=x, y=y, z=z, w=w))
    assert np.allclose(back, pose)


@pytest.mark.parametrize(
    ("position", "orientation", "said"),
    [
        ((np.nan, 0, 0), UNIT, "a position that is not finite"),
        ((0, np.inf, 0), UNIT, "a position that is not finite"),
        ((0, 0, 1), ros.Message(x=0, y=0, z=0, w=0), "a zero quaternion"),
        ((0, 0, 1), ros.Message(x=np.nan, y=0, z=0, w=1), "a quaternion that is not finite"),
        ((0, 0, 1), ros.Message(x=0, y=0, z=1, w=1), "a quaternion whose length is not 1"),
    ],
)
def test_what_is_no_pose_is_named(position, orientation, said):
    with pytest.raises(PoseMessageError, match=said):
        matrix_of(ros.vector(position), orientation)


def test_rounding_to_three_digits_is_no_error():
    assert matrix_of(ros.vector((0, 0, 1)), ros.Message(x=0.707, y=0, z=0, w=0.707)).shape == (4, 4)


def test_frames_lose_the_slash_of_ros_1():
    assert frame_name("/camera/optical ") == "camera/optical"


def test_stamps_of_ros_2_and_ros_1():
    assert stamp_of(ros.header(1.5)) == 1_500_000_000
    assert stamp_of(ros.Message(stamp=ros.Message(secs=1, nsecs=5))) == 1_000_000_005
    assert seconds(1_500_000_000) == 1.5
