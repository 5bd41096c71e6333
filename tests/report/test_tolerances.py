"""Tolerance maps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from graspcast.report.tolerances import tolerance_section

AXES = ("closing", "across", "approach")
CONTENT: dict[str, Any] = {
    "object": "d-1",
    "gripper": "parallel",
    "grasp": "reference",
    "at_true_pose": {"held": 9, "of": 10},
    "reaches": [
        {
            **{"kind": kind, "axis": axis, "sign": sign, "limit": 0.1, "trials": 24},
            "success_90": {"value": 0.01, "low": 0.008, "high": 0.012},
            "success_50": {"value": 0.02, "low": 0.018, "high": 0.022},
        }
        for kind in ("shift", "turn")
        for axis in AXES
        for sign in (-1, 1)
    ],
    "scale": {"value": 2.0, "low": 1.5, "high": 2.5},
}


def test_a_map_of_shifts_and_one_of_turns() -> None:
    shifts, turns = tolerance_section({Path("t.json"): CONTENT}).figures
    assert shifts.title == "Shifts that d-1 by parallel, grasp reference tolerates"
    assert len(shifts.rows) == 6 and shifts.rows[0][2:] == pytest.approx((10, 8, 12, 20))
    assert turns.rows[0][2] == pytest.approx(0.573, abs=1e-3)
    assert "At the true pose 9 of 10 succeed" in shifts.caption
    assert shifts.key != turns.key and "x (closing)" in shifts.svg
    assert tolerance_section({}).is_empty
