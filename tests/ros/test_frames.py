import numpy as np
import pytest

import ros_messages as ros
from graspcast.errors import InputError, TransformNotYetError
from graspcast.pose.transforms import rotation_from_vector
from graspcast.ros.frames import frame_of
from graspcast.ros.settings import Settings
from graspcast.ros.transform_buffer import TransformBuffer

KNOWN = frozenset({"ycbv-5", "ycbv-6"})
STAMP = 10 * ros.NS
POSE = ros.at(0.1, 0.2, 0.6)
POSE[:3, :3] = rotation_from_vector(np.array([0.3, -0.2, 0.5]))
# An optical frame in the frame of the camera's body: z forward is x there.
OPTICAL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1.0]])


def read(*found, frame=ros.CAMERA, buffer=None, settings=None, final=True):
    message = ros.detections(10.0, *found, frame=frame)
    settings = settings or Settings(ros.CAMERA, objects={"mustard": "ycbv-5"})
    return frame_of(
        {"epos": message}, STAMP, buffer or TransformBuffer(), settings, KNOWN, final=final
    )


def problem(*found, **given):
    """The one problem of detections of which none is used."""
    frame, problems = read(*found, **given)
    assert not len(frame.estimates["epos"])
    (line,) = problems.lines()
    return line


def test_detections_in_the_cameras_frame_are_estimates_as_they_are():
    frame, problems = read(
        ros.detection("mustard", POSE, 0.7), ros.detection("ycbv-6", POSE), frame=f"/{ros.CAMERA}"
    )
    first, second = frame.estimates["epos"]
    assert (first.object_name, first.score) == ("ycbv-5", 0.7)
    assert np.allclose(first.cam_T_obj, POSE)
    assert second.object_name == "ycbv-6"
    assert frame.time_s == 10.0 and frame.world_T_cam is None and not problems


def test_detections_in_another_frame_are_transformed_by_tf():
    buffer = TransformBuffer()
    buffer.add_all([ros.transform("body", ros.CAMERA, OPTICAL)], static=True)
    frame, problems = read(ros.detection("mustard", OPTICAL @ POSE), frame="body", buffer=buffer)
    assert np.allclose(frame.estimates["epos"][0].cam_T_obj, POSE) and not problems


def test_the_frame_may_be_that_of_the_single_detection():
    frame, problems = read(ros.detection("mustard", POSE, frame=ros.CAMERA), frame="")
    assert len(frame.estimates["epos"]) == 1 and not problems


def test_the_cameras_pose_in_the_world_is_looked_up_at_the_stamp():
    buffer = TransformBuffer()
    for second in (9.5, 10.0, 10.5):
        buffer.add_all([ros.transform(ros.BASE, ros.CAMERA, ros.at(second, 0, 1), second)])
    settings = Settings(ros.CAMERA, ros.BASE)
    frame, _ = read(ros.detection("ycbv-5", POSE), buffer=buffer, settings=settings)
    assert np.allclose(frame.world_T_cam, ros.at(10, 0, 1))


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (ros.detection("box", POSE), "estimate of an unknown class: 1 (first: 'box' by epos)"),
        (ros.detection("", POSE), "estimate of an unknown class: 1"),
        (ros.detection("mustard", ros.at(np.nan, 0, 1)), "with a position that is not finite: 1"),
        (ros.detection("mustard", np.eye(4)), "a placeholder: 1"),
        (ros.detection("mustard", ros.at(0, 0, -0.5)), "is 'camera_optical' the optical frame"),
        (ros.detection("mustard", POSE, np.nan), "with a score that is not finite: 1"),
        (ros.detection("mustard", POSE, frame="other"), "contradicts that of its message: 1"),
        (ros.Message(header=ros.header(0), results=[]), "without a hypothesis: 1"),
    ],
)
def test_what_is_no_sane_estimate_is_left_out_counted_and_named(found, said):
    assert said in problem(found)


def test_a_zero_quaternion_is_left_out():
    found = ros.detection("mustard", POSE)
    found.results[0].pose.pose.orientation = ros.Message(x=0, y=0, z=0, w=0)
    assert "estimate with a zero quaternion: 1" in problem(found)


def test_a_frame_without_a_transform_is_never_guessed():
    said = problem(ros.detection("mustard", POSE), frame="body")
    assert "without a transform to the camera" in said and "'body'" in said
    assert "without a transform" in problem(ros.detection("mustard", POSE), frame="")


def test_one_bad_detection_spoils_no_other():
    frame, problems = read(
        ros.detection("box", POSE), ros.detection("mustard", POSE), ros.detection("box", POSE)
    )
    assert len(frame.estimates["epos"]) == 1
    assert problems.counts() == {"estimate of an unknown class": 2}


def test_an_empty_message_says_that_nothing_was_found():
    frame, problems = read()
    assert not len(frame.estimates["epos"]) and not problems


def test_the_likeliest_hypothesis_counts():
    found = ros.detection("mustard", POSE, 0.4)
    found.results += ros.detection("ycbv-6", ros.at(0, 0, 1), 0.6).results
    frame, _ = read(found)
    (estimate,) = frame.estimates["epos"]
    assert estimate.object_name == "ycbv-6" and estimate.cam_T_obj[2, 3] == 1


def test_messages_of_ros_1_and_older_ros_2_have_the_class_one_level_higher():
    settings = Settings(ros.CAMERA, objects={"5": "ycbv-5"})
    for name in (5, "5"):
        found = ros.detection("", POSE)
        found.results = [ros.Message(id=name, score=0.5, pose=ros.Message(pose=ros.pose(POSE)))]
        frame, problems = read(found, settings=settings)
        assert frame.estimates["epos"][0].object_name == "ycbv-5" and not problems


def test_a_frame_whose_camera_pose_is_missing_is_not_judged():
    settings = Settings(ros.CAMERA, ros.BASE)
    frame, problems = read(ros.detection("ycbv-5", POSE), settings=settings)
    assert frame is None
    assert "frame without the camera's pose in the world: 1" in problems.lines()[0]


def test_a_transform_that_may_still_come_is_waited_for():
    buffer = TransformBuffer()
    buffer.add_all([ros.transform(ros.BASE, ros.CAMERA, np.eye(4), 9.9)])
    settings = Settings(ros.CAMERA, ros.BASE)
    with pytest.raises(TransformNotYetError):
        read(settings=settings, buffer=buffer, final=False)
    assert read(settings=settings, buffer=buffer)[0] is None
    buffer.add_all([ros.transform(ros.BASE, "body", np.eye(4), 9.9)])
    with pytest.raises(TransformNotYetError):
        read(ros.detection("ycbv-5", POSE), frame="body", buffer=buffer, final=False)


def test_other_messages_are_refused():
    other = ros.Message(header=ros.header(0), boxes=[])
    with pytest.raises(InputError, match="epos: messages should be vision_msgs/Detection3DArray"):
        frame_of({"epos": other}, STAMP, TransformBuffer(), Settings("c"), KNOWN)
