"""Whether a gripper's stated opening and tool centre point are those it has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from graspcast.io.conformance import UnmetError
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.trial.gripper_measurement import GripperMeasurement, measure_gripper
from graspcast.simulation.trial.gripper_tcp import check_aligned, check_centred, check_opening
from jaws import X, Y, write_jaws

OBLIQUE = "0.92387953 0 0 0.38268343"
BACK = "0 1 0 0"


def measured(tmp_path: Path, **changes: Any) -> GripperMeasurement:
    found = measure_gripper(load_gripper(write_jaws(tmp_path, **changes)))
    assert found is not None
    return found


@pytest.mark.parametrize("changes", [{}, {"x": 0.003, "quat": "0.9961947 0 0 0.0871557"}])
def test_a_right_tcp_passes_also_slightly_off(changes: dict[str, Any], tmp_path: Path) -> None:
    found = measured(tmp_path, **changes)
    assert "along x of the TCP" in check_aligned(found)
    assert "mm off the TCP" in check_centred(found)
    assert check_opening(found, 0.09) == "the open fingers are 94.0 mm apart (90.0 mm stated)"


@pytest.mark.parametrize(
    ("check", "changes", "message"),
    [
        ("aligned", {"quat": Y}, "move along y of the TCP, not along x.*turned by 90°"),
        ("aligned", {"quat": OBLIQUE}, "move at 45° to x of the TCP"),
        ("aligned", {"quat": X}, "move along z of the TCP"),
        ("aligned", {"quat": BACK}, "z of the TCP is 180° off the direction from the palm"),
        ("centred", {"x": 0.010, "off": 0.0}, r"10.0 mm off the TCP \(x -10.0, y \+0.0"),
        ("centred", {"x": 0.007, "off": -0.003}, "10.0 mm off the TCP"),
        ("centred", {"y": 0.010}, r"10.0 mm off the TCP \(x [+-]0.0, y -10.0"),
        ("centred", {"z": 0.070}, "and end at -10.0 mm: move the TCP"),
        ("centred", {"z": -0.020}, r"the fingers touch objects from \+\d+"),
        ("opening", {"opening": 0.14}, "are 94.0 mm apart .* max_opening_m is 140.0 mm"),
        ("opening", {"opening": 0.05}, "are 94.0 mm apart .* max_opening_m is 50.0 mm"),
    ],
)
def test_a_wrong_one_fails(
    check: str, changes: dict[str, Any], message: str, tmp_path: Path
) -> None:
    found = measured(tmp_path, **changes)
    with pytest.raises(UnmetError, match=message):
        if check == "opening":
            check_opening(found, changes["opening"])
        else:
            {"aligned": check_aligned, "centred": check_centred}[check](found)
