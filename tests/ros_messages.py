"""Messages of ROS as plain objects, and detections as detectors publish them."""

from __future__ import annotations

from types import SimpleNamespace as Message

import numpy as np

from graspcast.pose.transforms import quaternion

NS = 1_000_000_000
CAMERA, BASE = "camera_optical", "base"


def header(seconds: float, frame: str = CAMERA) -> Message:
    ns = round(seconds * NS)
    return Message(stamp=Message(sec=ns // NS, nanosec=ns % NS), frame_id=frame)


def vector(xyz) -> Message:
    x, y, z = (float(v) for v in xyz)
    return Message(x=x, y=y, z=z)


def orientation(rotation) -> Message:
    w, x, y, z = quaternion(np.asarray(rotation, dtype=float)).tolist()
    return Message(x=x, y=y, z=z, w=w)


def pose(matrix) -> Message:
    return Message(position=vector(matrix[:3, 3]), orientation=orientation(matrix[:3, :3]))


def detection(class_id: str, matrix, score: float = 0.9, frame: str = "") -> Message:
    hypothesis = Message(class_id=class_id, score=score)
    result = Message(hypothesis=hypothesis, pose=Message(pose=pose(matrix)))
    return Message(header=header(0, frame), results=[result])


def detections(seconds: float, *found: Message, frame: str = CAMERA) -> Message:
    return Message(header=header(seconds, frame), detections=list(found))


def transform(parent: str, child: str, matrix, seconds: float = 0.0) -> Message:
    rotation, translation = orientation(matrix[:3, :3]), vector(matrix[:3, 3])
    return Message(
        header=header(seconds, parent),
        child_frame_id=child,
        transform=Message(translation=translation, rotation=rotation),
    )


def at(x: float, y: float, z: float) -> np.ndarray:
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out
