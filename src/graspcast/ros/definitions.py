"""Definitions of the messages that graspcast reads and writes, and that bags may lack.

Those of ``graspcast_msgs`` are the files of ``ros/graspcast_msgs/msg``, word for word.
"""

from __future__ import annotations

__all__ = [
    "DETECTIONS",
    "GRASPCAST_MSGS",
    "OUTCOME",
    "TF2_MSGS",
    "TRANSFORMS",
    "VERDICTS",
    "VISION_MSGS",
    "VISION_MSGS_ROS1",
]

DETECTIONS = "vision_msgs/msg/Detection3DArray"
VERDICTS = "graspcast_msgs/msg/VerdictArray"
OUTCOME = "graspcast_msgs/msg/Outcome"
TRANSFORMS = "tf2_msgs/msg/TFMessage"

TF2_MSGS = {TRANSFORMS: "geometry_msgs/TransformStamped[] transforms\n"}

VISION_MSGS = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\n"
        "vision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\n"
        "string id\n"
    ),
    DETECTIONS: "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}
"""``vision_msgs`` 4, of ROS 2 Humble and later."""

VISION_MSGS_ROS1 = {
    **VISION_MSGS,
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "int64 id\nfloat64 score\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\n"
        "vision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\n"
        "sensor_msgs/PointCloud2 source_cloud\n"
    ),
}
"""``vision_msgs`` of ROS 1 Noetic: classes are whole numbers, and detections have no id."""
del VISION_MSGS_ROS1["vision_msgs/msg/ObjectHypothesis"]

GRASPCAST_MSGS = {
    "graspcast_msgs/msg/Verdict": """\
# The verdict on one object in one frame: whether to attempt its grasp. Poses are metres.

uint8 ABSTAIN=0
uint8 LOOK_AGAIN=1
uint8 ATTEMPT=2
uint8 action

# Of this decision; an Outcome refers to it.
string id
# The same number for the same object from look to look; -1 for one that was not found.
int32 instance
# As the model knows it (ycbv-5), and as detections name it.
string object_name
string class_id

# Of success, and the least that is attempted; both 0 where there is no forecast.
bool probability_known
float64 probability
float64 threshold
string guarantee
# Why, in words, and what is in doubt.
string reason
string[] notes

# Whose pose guides the grasp: an estimator, or "fused". Empty without a pose.
string guide
# The object's pose in header.frame_id of the array, and in its world_frame.
bool pose_known
geometry_msgs/Pose pose
bool world_pose_known
geometry_msgs/Pose world_pose

string gripper
string grasp
# Where the gripper's tool centre point goes (z: approach, x: closing), in the same two frames.
bool grasp_pose_known
geometry_msgs/Pose grasp_pose
bool world_grasp_pose_known
geometry_msgs/Pose world_grasp_pose

# From the object to the camera of the next look, unit vectors in the same two frames.
bool look_known
geometry_msgs/Vector3 look_direction
bool world_look_known
geometry_msgs/Vector3 world_look_direction

# Looks that entered, and looks so far.
uint32 views
uint32 looks
""",
    VERDICTS: """\
# The verdicts on all objects in one frame; none where it cannot be judged, and notes say why.

# Stamp of the frame, and the camera's optical frame.
std_msgs/Header header
# Empty where the camera's pose in the world is not used.
string world_frame
# Looks at one scene share an episode; empty where the frame was not judged.
string episode
uint32 look
# Estimators that sent nothing for this frame in time.
string[] missing
# What was left out of the frame, and why.
string[] notes
Verdict[] verdicts
""",
    OUTCOME: """\
# The outcome of an attempted grasp, for the attempt log.

# Verdict.id of the attempt.
string decision
bool success
# Why it failed, in a few words; may be empty.
string reason
""",
}
