"""Records for tests of the attempt log."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from graspcast.attempt_log import DecisionRecord, FrameRecord
from graspcast.guarantees.certificate import Certificate
from graspcast.guarantees.certify import certify

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


def certified(rate: float = 0.9, **provenance: Any) -> Certificate:
    """Return a certificate, overall and of ycbv-5 and ycbv-6, with the threshold 0.8."""
    n = np.arange(160)
    objects = np.array(["ycbv-5", "ycbv-6"])[n % 2]
    made = certify(
        np.full(160, 0.9),
        n >= 0,
        n // 2,
        objects=objects,
        rate=rate,
        confidence=0.9,
        provenance=provenance,
    )
    guarantees = tuple(replace(g, threshold=0.8, reported_threshold=0.8) for g in made.guarantees)
    return replace(made, guarantees=guarantees)
