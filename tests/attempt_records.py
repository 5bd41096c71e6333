"""Records for tests of the attempt log."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import numpy as np

from graspcast.attempt_log import DecisionRecord, FrameRecord

NOON = datetime(2026, 3, 1, 12, tzinfo=UTC)


def pose(x_m: float = 0.0) -> np.ndarray:
    out = np.eye(4)
    out[:3, 3] = x_m, 0.0, 0.8
    return out


def decision(number: int = 0, **changed: Any) -> DecisionRecord:
    values: dict[str, Any] = {
        "id": f"d{number}",
        "instance": 0,
        "object_name": "ycbv-5",
        "action": "attempt",
        "probability": 0.9,
        "threshold": 0.8,
        "guarantee": None,
        "reason": "probability 0.900 reaches 0.8",
        "guide": "epos",
        "cam_T_obj": pose(),
        "world_T_obj": None,
        "gripper": "franka",
        "grasp": "reference",
        "views": 1,
        "looks": 1,
    }
    return DecisionRecord(**(values | changed))


def frame(number: int = 0, *decisions: DecisionRecord, **changed: Any) -> FrameRecord:
    found = {"epos": [("ycbv-5", pose(), 0.9)], "gdrnpp": [("ycbv-5", pose(0.001), 0.8)]}
    values: dict[str, Any] = {
        "episode": f"e{number}",
        "look": 1,
        "estimates": found,
        "decisions": decisions or (decision(number),),
        "model": "m" * 64,
        "time_utc": NOON,
    }
    return FrameRecord(**(values | changed))
