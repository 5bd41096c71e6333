"""Measured closing direction, gap, opening, approach and grip force, against known grippers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspcast.io.conformance import UnmetError
from graspcast.simulation.grippers import FrankaHand, TendonHand, load_gripper
from graspcast.simulation.trial.gripper_measurement import (
    Corrected,
    GripperMeasurement,
    measure_gripper,
)
from jaws import X, Y, write_jaws

THREE_JAW = Path(__file__).parents[2] / "data" / "three_jaw.toml"


def measured(gripper: Any) -> GripperMeasurement:
    found = measure_gripper(gripper)
    assert found is not None
    return found


def test_jaws_of_known_opening_gap_and_force(tmp_path: Path) -> None:
    found = measured(load_gripper(write_jaws(tmp_path)))
    assert not found.all_sides
    assert abs(found.closing[0]) == pytest.approx(1, abs=1e-3)
    assert found.approach == pytest.approx([0, 0, 1], abs=1e-3)
    assert found.gap_m[:2] == pytest.approx([0, 0], abs=2e-4)
    # Inner surfaces 45 + 2 mm from the middle.
    assert found.opening_m == pytest.approx(0.094, abs=2e-4)
    # The pads end 10 mm beyond the TCP.
    assert found.tip_m == pytest.approx(0.010, abs=5e-4)
    assert found.touch_m[1] == pytest.approx(0.010, abs=2e-3)
    assert found.base_T_tcp[:2, 3] == pytest.approx([0, 0], abs=2e-4)


def test_jaws_that_close_outwards(tmp_path: Path) -> None:
    outwards = {"open": "{ l = 0.0, r = 0.0 }", "close": "{ l = 0.045, r = 0.045 }"}
    with pytest.raises(UnmetError, match=r"closes outwards: .* apart by 90 mm; exchange open and"):
        measure_gripper(load_gripper(write_jaws(tmp_path, **outwards)))


def test_a_single_jaw_against_the_hand_itself(tmp_path: Path) -> None:
    path = write_jaws(tmp_path, open="{ r = 0.045 }", close="{ r = 0.0 }")
    mjcf = (tmp_path / "jaws.xml").read_text()
    lines = [line for line in mjcf.splitlines() if '<position name="l"' not in line]
    mjcf = "\n".join(lines).replace('<joint name="jl" axis="-1 0 0" class="jaw"/>', "")
    (tmp_path / "jaws.xml").write_text(mjcf)
    found = measured(load_gripper(path))
    # One surface stands 2 mm from the middle, the other opens to 47 mm.
    assert found.opening_m == pytest.approx(0.049, abs=2e-4)
    assert found.closing_angle_deg < 1


@pytest.mark.parametrize(
    ("changes", "closing", "approach"),
    [({"quat": Y}, [0, 1, 0], [0, 0, 1]), ({"quat": X}, [0, 0, 1], [-1, 0, 0])],
)
def test_directions_are_in_the_frame_of_the_stated_tcp(
    changes: dict[str, Any], closing: list[float], approach: list[float], tmp_path: Path
) -> None:
    found = measured(load_gripper(write_jaws(tmp_path, **changes)))
    assert np.abs(found.closing) == pytest.approx(closing, abs=1e-3)
    assert found.approach == pytest.approx(approach, abs=1e-3)


def test_the_gap_is_found_wherever_the_tcp_is(tmp_path: Path) -> None:
    stated = {"x": 0.010, "y": -0.004, "z": 0.045}
    gripper = load_gripper(write_jaws(tmp_path, **stated))
    found = measured(gripper)
    assert found.gap_m[:2] == pytest.approx([-0.010, 0.004], abs=2e-4)
    assert found.base_T_tcp[:2, 3] == pytest.approx([0, 0], abs=2e-4)
    again = measured(Corrected(gripper, found.base_T_tcp))
    assert again.gap_m == pytest.approx([0, 0, 0], abs=2e-4)


def test_the_built_in_hands_are_what_they_state() -> None:
    franka = measured(FrankaHand())
    assert franka.opening_m == pytest.approx(0.08, abs=5e-4)
    assert franka.gap_m == pytest.approx([0, 0, 0], abs=1e-3)
    assert franka.closing_angle_deg < 0.1
    assert franka.approach_angle_deg < 0.1
    tendon = measured(TendonHand())
    assert tendon.opening_m == pytest.approx(TendonHand().max_opening_m, rel=0.1)
    assert tendon.gap_m[:2] == pytest.approx([0, 0], abs=1e-3)


def test_a_chuck_closes_from_all_sides() -> None:
    gripper = load_gripper(THREE_JAW)
    found = measured(gripper)
    assert found.all_sides
    assert found.closing == pytest.approx([0, 0, 1], abs=1e-3)
    assert found.opening_m == pytest.approx(0.09, abs=5e-4)
    rows = {name: (value, stated) for name, value, stated in found.rows(gripper)}
    assert rows["closing direction"] == ("from all sides", "x of the TCP")


def test_the_table_names_what_is_measured_and_what_is_stated(tmp_path: Path) -> None:
    gripper = load_gripper(write_jaws(tmp_path, quat=Y, opening=0.09))
    found = measured(gripper)
    rows = {name: (value, stated) for name, value, stated in found.rows(gripper)}
    assert rows["closing direction"] == ("y of the TCP", "x of the TCP")
    assert rows["opening"] == ("94.0 mm", "90.0 mm")
    assert rows["grip force on 45 mm"][0] == "unknown"
    known = {name: value for name, value, _ in found.with_grip(40.0).rows(gripper)}
    assert known["grip force on 45 mm"] == "40.0 N a side"
