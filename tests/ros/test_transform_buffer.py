import numpy as np
import pytest

import ros_messages as ros
from graspcast.errors import TransformMissingError, TransformNotYetError
from graspcast.pose.transforms import compose, invert, rotation_from_vector
from graspcast.ros.transform_buffer import TransformBuffer

TURNED = np.eye(4)
TURNED[:3, :3] = rotation_from_vector(np.array([0.0, 0.0, 1.0]))


def filled(*moving, static=()):
    buffer = TransformBuffer()
    buffer.add_all(static, static=True)
    buffer.add_all(moving)
    return buffer


def test_a_chain_is_followed_both_ways():
    hand, camera = ros.at(0, 0, 1), TURNED @ ros.at(0.1, 0, 0)
    buffer = filled(
        ros.transform("base", "hand", hand, 5.0), static=[ros.transform("hand", "camera", camera)]
    )
    found = buffer.lookup("base", "/camera", 5 * ros.NS)
    assert np.allclose(found, compose(hand, camera))
    assert np.allclose(buffer.lookup("camera", "base", 5 * ros.NS), invert(found))
    assert buffer.frames() == ["base", "camera", "hand"]


def test_siblings_meet_at_the_frame_they_share():
    static = [ros.transform("base", "a", ros.at(1, 0, 0)), ros.transform("base", "b", TURNED)]
    found = filled(static=static).lookup("a", "b", 0)
    assert np.allclose(found, ros.at(-1, 0, 0) @ TURNED)


def test_between_two_stamps_position_and_rotation_are_interpolated():
    turned = np.eye(4)
    turned[:3, :3] = rotation_from_vector(np.array([0.0, 0.0, 0.8]))
    turned[0, 3] = 1.0
    buffer = filled(
        ros.transform("base", "camera", np.eye(4), 1.0),
        ros.transform("base", "camera", turned, 2.0),
    )
    found = buffer.lookup("base", "camera", round(1.25 * ros.NS))
    assert np.allclose(found[:3, :3], rotation_from_vector(np.array([0.0, 0.0, 0.2])))
    assert np.allclose(found[:3, 3], [0.25, 0, 0])


def test_messages_may_come_in_any_order():
    buffer = filled(
        ros.transform("base", "camera", ros.at(2, 0, 0), 2.0),
        ros.transform("base", "camera", ros.at(1, 0, 0), 1.0),
        ros.transform("base", "camera", ros.at(1.8, 0, 0), 1.5),
    )
    assert buffer.lookup("base", "camera", round(1.25 * ros.NS))[0, 3] == pytest.approx(1.4)


def test_nothing_is_extrapolated():
    buffer = filled(
        ros.transform("base", "camera", np.eye(4), 1.0),
        ros.transform("base", "camera", np.eye(4), 2.0),
    )
    with pytest.raises(
        TransformNotYetError, match=r"latest transform of 'camera'.*0\.500 s too old"
    ):
        buffer.lookup("base", "camera", round(2.5 * ros.NS))
    with pytest.raises(TransformMissingError, match=r"first transform .* 0\.500 s too late"):
        buffer.lookup("base", "camera", round(0.5 * ros.NS))


def test_a_gap_is_not_bridged():
    buffer = filled(
        ros.transform("base", "camera", np.eye(4), 1.0),
        ros.transform("base", "camera", np.eye(4), 3.0),
    )
    with pytest.raises(TransformMissingError, match=r"2\.000 s apart"):
        buffer.lookup("base", "camera", 2 * ros.NS)


def test_unknown_and_unconnected_frames_are_named_with_the_known_ones():
    buffer = filled(static=[ros.transform("a", "b", TURNED), ros.transform("c", "d", TURNED)])
    with pytest.raises(TransformMissingError, match="'map' is unknown; frames known: a, b, c, d"):
        buffer.lookup("map", "b", 0)
    with pytest.raises(TransformMissingError, match="not connected"):
        buffer.lookup("a", "d", 0)


def test_a_loop_is_an_error_and_no_endless_loop():
    static = [ros.transform("a", "b", TURNED), ros.transform("b", "a", TURNED)]
    with pytest.raises(TransformMissingError, match="form a loop"):
        filled(static=static).lookup("a", "c", 0)


def test_what_is_no_transform_is_counted_and_not_used():
    buffer = filled(
        ros.transform("base", "camera", ros.at(np.nan, 0, 0)),
        ros.transform("camera", "camera", TURNED),
        ros.transform("", "camera", TURNED),
    )
    zero = ros.transform("base", "camera", TURNED)
    zero.transform.rotation = ros.Message(x=0, y=0, z=0, w=0)
    buffer.add_all([zero])
    assert buffer.problems.counts() == {
        "transform with a position that is not finite": 1,
        "transform without two frames": 2,
        "transform with a zero quaternion": 1,
    }
    assert buffer.frames() == []


def test_two_parents_and_a_static_frame_that_moves_are_counted():
    buffer = filled(
        ros.transform("base", "camera", TURNED, 1.0),
        static=[ros.transform("hand", "camera", TURNED)],
    )
    assert "moving transform of a static frame" in buffer.problems.counts()
    buffer.add_all([ros.transform("map", "robot", TURNED, 1.0)])
    buffer.add_all([ros.transform("odom", "robot", TURNED, 1.0)])
    assert buffer.problems.counts()["transform that gives a frame another parent"] == 2
    assert np.allclose(buffer.lookup("odom", "robot", ros.NS), TURNED)


def test_old_transforms_are_dropped_and_a_clock_set_back_can_be_cleared():
    buffer = TransformBuffer(keep_s=10.0)
    for second in range(1, 100):
        buffer.add_all([ros.transform("base", "camera", TURNED, second)])
    with pytest.raises(TransformMissingError, match="too late"):
        buffer.lookup("base", "camera", 50 * ros.NS)
    buffer.add_all([ros.transform("base", "camera", TURNED, 1.0)])
    assert buffer.problems.counts() == {"transform that is older than those kept": 1}
    buffer.clear()
    buffer.add_all([ros.transform("base", "camera", TURNED, 1.0)])
    assert np.allclose(buffer.lookup("base", "camera", ros.NS), TURNED)


def test_a_frame_in_itself_needs_no_transform():
    assert np.allclose(TransformBuffer().lookup("/camera", "camera", 0), np.eye(4))
