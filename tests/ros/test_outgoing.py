from typing import Any

import numpy as np
import pytest

import ros_messages as ros
from graspcast.pose.transforms import rotation_from_vector
from graspcast.ros.bag_types import maker_of, own_types
from graspcast.ros.definitions import DETECTIONS, VERDICTS
from graspcast.ros.judging import Judged
from graspcast.ros.outgoing import detection_array, verdict_array
from graspcast.ros.poses import matrix_of
from graspcast.ros.problems import Problems
from graspcast.ros.settings import Settings
from graspcast.runtime.answer import Answer, Decision
from graspcast.views.next_look import NextLook

SETTINGS = Settings(ros.CAMERA, ros.BASE, objects={"5": "ycbv-5"})
STAMP = 1_700_000_000_123_456_789
POSES = {
    name: ros.at(0.1 * k, 0.2, 0.5)
    for k, name in enumerate(("cam_T_obj", "world_T_obj", "cam_T_grasp", "world_T_grasp"))
}
POSES["cam_T_obj"][:3, :3] = rotation_from_vector(np.array([0.1, 2.0, -0.4]))


def decision(**changes: Any) -> Decision:
    known: dict[str, Any] = {
        "id": "0123",
        "instance": 2,
        "object_name": "ycbv-5",
        "action": "attempt",
        "probability": 0.93,
        "threshold": 0.8,
        "guarantee": "90 % at 95 %",
        "reason": "probable enough",
        "guide": "epos",
        "gripper": "panda",
        "grasp": "reference",
        "next_look": None,
        "views": 1,
        "looks": 1,
        "notes": ("in doubt",),
        **POSES,
    }
    return Decision(**(known | changes))


def judged(*decisions: Decision, missing: tuple[str, ...] = ()) -> Judged:
    problems = Problems()
    problems.add("estimate of an unknown class", "'box' by epos")
    return Judged(STAMP, Answer("e1", 1, decisions, ("a note",)), missing, problems)


@pytest.fixture(params=[False, True], ids=["ros2", "ros1"])
def through(request):
    """Return a function that builds a message, writes and reads it."""
    ros1 = request.param
    types = own_types(ros1=ros1)

    def sent(build, name, *given):
        message = build(maker_of(types, ros1=ros1), judged(*given, missing=("gdrnpp",)), SETTINGS)
        if ros1:
            return types.deserialize_ros1(types.serialize_ros1(message, name), name)
        return types.deserialize_cdr(types.serialize_cdr(message, name), name)

    sent.ros1 = ros1
    return sent


def test_a_verdict_says_all_that_was_decided(through):
    array = through(verdict_array, VERDICTS, decision())
    assert (array.header.stamp.sec, array.header.stamp.nanosec) == (1_700_000_000, 123_456_789)
    assert (array.header.frame_id, array.world_frame) == (ros.CAMERA, ros.BASE)
    assert (array.episode, array.look, array.missing) == ("e1", 1, ["gdrnpp"])
    assert array.notes == ["estimate of an unknown class: 1 (first: 'box' by epos)", "a note"]
    (verdict,) = array.verdicts
    assert verdict.action == 2 and verdict.id == "0123" and verdict.instance == 2
    assert (verdict.object_name, verdict.class_id) == ("ycbv-5", "5")
    assert verdict.probability_known
    assert (verdict.probability, verdict.threshold) == (0.93, 0.8)
    assert (verdict.guarantee, verdict.reason) == ("90 % at 95 %", "probable enough")
    assert (verdict.guide, verdict.gripper, verdict.grasp) == ("epos", "panda", "reference")
    assert (verdict.views, verdict.looks, verdict.notes) == (1, 1, ["in doubt"])
    names = {"pose": "cam_T_obj", "world_pose": "world_T_obj", "grasp_pose": "cam_T_grasp"}
    for name, of in (names | {"world_grasp_pose": "world_T_grasp"}).items():
        pose = getattr(verdict, name)
        assert getattr(verdict, f"{name}_known")
        assert np.allclose(matrix_of(pose.position, pose.orientation), POSES[of])
    assert not verdict.look_known and not verdict.world_look_known


def test_what_is_not_known_is_said_and_the_default_is_to_abstain(through):
    none = dict.fromkeys((*POSES, "probability", "threshold", "guarantee", "guide"))
    array = through(verdict_array, VERDICTS, decision(action="abstain", instance=-1, **none))
    (verdict,) = array.verdicts
    assert verdict.action == 0 and not verdict.probability_known and verdict.instance == -1
    assert not (verdict.pose_known or verdict.world_pose_known)
    assert not (verdict.grasp_pose_known or verdict.world_grasp_pose_known)
    assert (verdict.probability, verdict.threshold, verdict.guide) == (0.0, 0.0, "")


def test_a_next_look_has_its_direction_in_both_frames(through):
    axis = np.array([0.0, 0.0, 1.0])
    look = NextLook(np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), axis, 0.01, 0.5)
    (verdict,) = through(
        verdict_array, VERDICTS, decision(action="look again", next_look=look)
    ).verdicts
    assert verdict.action == 1 and verdict.look_known and verdict.world_look_known
    assert (verdict.look_direction.x, verdict.world_look_direction.y) == (1.0, 1.0)


def test_detections_have_the_probability_as_score_and_the_guides_pose(through):
    array = through(detection_array, DETECTIONS, decision(), decision(cam_T_obj=None))
    assert array.header.frame_id == ros.CAMERA
    (detection,) = array.detections
    (result,) = detection.results
    pose = result.pose.pose
    assert np.allclose(matrix_of(pose.position, pose.orientation), POSES["cam_T_obj"])
    assert not result.pose.covariance.any()
    if through.ros1:
        assert (result.id, result.score) == (5, 0.93)
    else:
        assert (result.hypothesis.class_id, result.hypothesis.score) == ("5", 0.93)
        assert detection.id == "0123"


def test_a_pose_without_a_forecast_has_score_zero(through):
    array = through(detection_array, DETECTIONS, decision(probability=None, action="abstain"))
    result = array.detections[0].results[0]
    assert (result.score if through.ros1 else result.hypothesis.score) == 0.0


def test_a_frame_that_could_not_be_judged_says_why():
    types = own_types(ros1=False)
    problems = Problems()
    problems.add("frame without the camera's pose in the world", "no transform")
    array = verdict_array(maker_of(types, ros1=False), Judged(STAMP, None, (), problems), SETTINGS)
    assert array.verdicts == [] and array.episode == ""
    assert array.notes == ["frame without the camera's pose in the world: 1 (first: no transform)"]
