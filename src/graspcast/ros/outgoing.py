"""Outgoing messages: verdicts as detections of ``vision_msgs``, and as ``graspcast_msgs``.

A *maker* builds messages: ``make("geometry_msgs/msg/Point", x=1.0, y=2.0, z=3.0)``. A node's makes
those of ``rclpy``, a bag's those of ``rosbags``.
"""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.ros.definitions import DETECTIONS, VERDICTS
from graspcast.ros.judging import Judged
from graspcast.ros.poses import orientation_of
from graspcast.ros.settings import Settings
from graspcast.runtime.answer import Decision

__all__ = ["ACTIONS", "Maker", "detection_array", "verdict_array"]

ACTIONS = {"abstain": 0, "look again": 1, "attempt": 2}
"""Action to the constants of ``Verdict.msg``."""
_NS = 1_000_000_000


@runtime_checkable
class Maker(Protocol):
    """A function that builds a message of a type from its fields."""

    def __call__(self, type_name: str, /, **fields: Any) -> Any:
        """Return the message."""
        ...


def verdict_array(make: Maker, judged: Judged, settings: Settings) -> Any:
    """Return a ``graspcast_msgs/VerdictArray``: the verdicts on one frame, and what it lacked."""
    answer = judged.answer
    decisions = () if answer is None else answer.decisions
    notes = [*judged.problems.lines(), *(() if answer is None else answer.notes)]
    return make(
        VERDICTS,
        header=_header(make, judged, settings),
        world_frame=settings.world_frame or "",
        episode="" if answer is None else answer.episode,
        look=0 if answer is None else answer.look,
        missing=list(judged.missing),
        notes=notes,
        verdicts=[_verdict(make, decision, settings) for decision in decisions],
    )


def detection_array(make: Maker, judged: Judged, settings: Settings) -> Any:
    """Return a ``vision_msgs/Detection3DArray``: guide poses, scored by probability of success.

    Objects without a pose are left out. A pose without a forecast has score 0. The covariance is
    not known: it is all zeros.
    """
    header = _header(make, judged, settings)
    decisions = () if judged.answer is None else judged.answer.decisions
    detections = []
    for decision in decisions:
        if decision.cam_T_obj is None:
            continue
        pose = _pose(make, decision.cam_T_obj)
        hypothesis = make(
            "vision_msgs/msg/ObjectHypothesisWithPose",
            hypothesis=make(
                "vision_msgs/msg/ObjectHypothesis",
                class_id=settings.class_of(decision.object_name),
                score=float(decision.probability or 0.0),
            ),
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=np.zeros(36)),
        )
        box = make("vision_msgs/msg/BoundingBox3D", center=pose, size=_vector(make, np.zeros(3)))
        detections.append(
            make(
                "vision_msgs/msg/Detection3D",
                header=header,
                results=[hypothesis],
                bbox=box,
                id=str(decision.id),
            )
        )
    return make(DETECTIONS, header=header, detections=detections)


def _verdict(make: Maker, decision: Decision, settings: Settings) -> Any:
    look = decision.next_look
    known = {
        "pose": decision.cam_T_obj,
        "world_pose": decision.world_T_obj,
        "grasp_pose": decision.cam_T_grasp,
        "world_grasp_pose": decision.world_T_grasp,
    }
    fields: dict[str, Any] = {}
    for name, pose in known.items():
        fields[f"{name}_known"] = pose is not None
        fields[name] = _pose(make, np.eye(4) if pose is None else pose)
    directions = {
        "look": None if look is None else look.direction,
        "world_look": None if look is None else look.direction_world,
    }
    for name, direction in directions.items():
        fields[f"{name}_known"] = direction is not None
        fields[f"{name}_direction"] = _vector(make, np.zeros(3) if direction is None else direction)
    return make(
        "graspcast_msgs/msg/Verdict",
        action=ACTIONS[decision.action],
        id=str(decision.id),
        instance=int(decision.instance),
        object_name=decision.object_name,
        class_id=settings.class_of(decision.object_name),
        probability_known=decision.probability is not None,
        probability=float(decision.probability or 0.0),
        threshold=float(decision.threshold or 0.0),
        guarantee=decision.guarantee or "",
        reason=decision.reason,
        notes=[str(text) for text in decision.notes],
        guide=decision.guide or "",
        gripper=decision.gripper or "",
        grasp=decision.grasp or "",
        views=int(decision.views),
        looks=int(decision.looks),
        **fields,
    )


def _header(make: Maker, judged: Judged, settings: Settings) -> Any:
    stamp = make("builtin_interfaces/msg/Time", sec=judged.stamp // _NS, nanosec=judged.stamp % _NS)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=settings.camera_frame)


def _pose(make: Maker, pose: Float[ndarray, "4 4"]) -> Any:
    x, y, z = pose[:3, 3].tolist()
    names = dict(zip("xyzw", orientation_of(pose), strict=True))
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=make("geometry_msgs/msg/Quaternion", **names),
    )


def _vector(make: Maker, vector: Float[ndarray, "3"]) -> Any:
    x, y, z = vector.tolist()
    return make("geometry_msgs/msg/Vector3", x=x, y=y, z=z)
