"""Poses of ROS messages as matrices and back: metres, quaternions xyzw, checked.

Messages are duck-typed: whatever has the fields of ``geometry_msgs`` will do.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import quaternion, rotation_from_quaternion

__all__ = [
    "PoseMessageError",
    "Stamp",
    "frame_name",
    "matrix_of",
    "orientation_of",
    "seconds",
    "stamp_of",
]

_MAX_NORM_DEVIATION = 0.01
"""Of a quaternion's length from 1; what rounding to float32 or a few digits leaves is far less."""
_NS = 1_000_000_000

Stamp = int
"""Nanoseconds since the clock's epoch."""


class PoseMessageError(ValueError):
    """A message's position or quaternion is no pose; the text says why."""


def matrix_of(position: Any, orientation: Any) -> Float[ndarray, "4 4"]:
    """Return the transform of a position and an orientation.

    Parameters
    ----------
    position
        With x, y, z in metres: a ``Point`` or a ``Vector3``.
    orientation
        With x, y, z, w: a ``Quaternion``.

    Raises
    ------
    PoseMessageError
        For numbers that are not finite, and quaternions whose length is not 1.
    """
    x, y, z = float(position.x), float(position.y), float(position.z)
    q = (
        float(orientation.w),
        float(orientation.x),
        float(orientation.y),
        float(orientation.z),
    )
    if not all(map(math.isfinite, (x, y, z))):
        raise PoseMessageError("a position that is not finite")
    if not all(map(math.isfinite, q)):
        raise PoseMessageError("a quaternion that is not finite")
    norm = math.sqrt(sum(value * value for value in q))
    if norm == 0.0:
        raise PoseMessageError("a zero quaternion")
    if abs(norm - 1.0) > _MAX_NORM_DEVIATION:
        raise PoseMessageError("a quaternion whose length is not 1")
    out = np.eye(4)
    out[:3, :3] = rotation_from_quaternion(np.array(q) / norm)
    out[:3, 3] = x, y, z
    return out


def orientation_of(pose: Float[ndarray, "4 4"]) -> tuple[float, float, float, float]:
    """Return a pose's quaternion as messages have it: x, y, z, w."""
    w, x, y, z = quaternion(pose[:3, :3]).tolist()
    return x, y, z, w


def frame_name(frame_id: str) -> str:
    """Return a frame's name without the leading slash that ROS 1 had."""
    return frame_id.strip().lstrip("/")


def stamp_of(header: Any) -> Stamp:
    """Return a header's stamp in nanoseconds, of ROS 2, or of ROS 1 with ``secs`` and ``nsecs``."""
    stamp = header.stamp
    if hasattr(stamp, "sec"):
        return int(stamp.sec) * _NS + int(stamp.nanosec)
    return int(stamp.secs) * _NS + int(stamp.nsecs)


def seconds(nanoseconds: Stamp) -> float:
    """Return a stamp or a duration in seconds."""
    return nanoseconds / _NS
