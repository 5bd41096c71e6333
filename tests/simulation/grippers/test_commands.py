"""Commands of a hand: controls, keyframes and drives."""

from __future__ import annotations

from pathlib import Path

import pytest

from graspcast.errors import FormatError, UnknownNameError
from graspcast.simulation.grippers import load_gripper
from jaws import write_jaws, write_urdf_jaws

CONTROLS = """<keyframe>
  <key name="wide" ctrl="0.04 0.03"/><key name="shut" ctrl="0 0.001"/>
</keyframe>"""
POSTURES = """<keyframe>
  <key name="wide" qpos="0.04 0.03"/><key name="shut" qpos="-0.0005 0.001"/>
</keyframe>"""


@pytest.mark.parametrize("keys", [CONTROLS, POSTURES])
def test_keyframes_are_open_and_close(keys: str, tmp_path: Path) -> None:
    path = write_jaws(tmp_path, more=keys, open='"wide"', close='"shut"')
    closing = load_gripper(path).closing
    assert dict(closing.open) == pytest.approx({"l": 0.04, "r": 0.03})
    # A control is clamped to its range, which ends at 0.
    assert dict(closing.close) == pytest.approx({"l": 0.0, "r": 0.001})


def test_a_keyframe_and_controls_may_be_mixed(tmp_path: Path) -> None:
    path = write_jaws(tmp_path, more=CONTROLS, open='"wide"')
    assert dict(load_gripper(path).closing.close) == {"l": 0.0, "r": 0.0}


def test_a_keyframe_that_is_not_there(tmp_path: Path) -> None:
    path = write_jaws(tmp_path, more=CONTROLS, open='"wider"')
    with pytest.raises(UnknownNameError, match=r"keyframe 'wider'.*did you mean 'wide'"):
        load_gripper(path)


def test_a_posture_says_nothing_of_a_motor(tmp_path: Path) -> None:
    more = POSTURES + "<actuator/>"
    path = write_jaws(tmp_path, more=more, open='"wide"', close='"shut"')
    mjcf = (tmp_path / "jaws.xml").read_text()
    mjcf = mjcf.replace('<position name="l" joint="jl" kp="3000"', '<motor name="l" joint="jl"')
    (tmp_path / "jaws.xml").write_text(mjcf)
    with pytest.raises(FormatError, match="'wide' has no ctrl, and not all actuators are position"):
        load_gripper(path)


@pytest.mark.parametrize(
    ("actuators", "message"),
    [
        ("", r"jaws.urdf.*has no actuator.*\[actuators\] of jaws.toml"),
        ("[actuators.drive]\njoint = 'jl'\n", r"\[actuators\] drive: stiffness is missing"),
        ("[actuators.drive]\njoint = 'jl'\nstiffness = 0\n", "stiffness is 0.0, and must be"),
        ("[actuators.drive]\njoint='jl'\nstiffness=9\nforce=-1\n", "force is -1.0.* not negative"),
        ("[actuators.drive]\njoint='jl'\nstiffness=9\nkp=1\n", "unknown key 'kp'"),
        ("[actuators.drive]\njoint='j'\nstiffness=9\n", "unknown joint 'j'.*known: jl, jr"),
        ("[actuators]\ndrive = 3\n", "should be a table, not 3"),
    ],
)
def test_a_wrong_drive_is_explained(actuators: str, message: str, tmp_path: Path) -> None:
    path = write_urdf_jaws(tmp_path, actuators=actuators)
    with pytest.raises((FormatError, UnknownNameError), match=message):
        load_gripper(path)


def test_drives_of_a_model_with_actuators_are_refused(tmp_path: Path) -> None:
    path = write_jaws(tmp_path)
    path.write_text(path.read_text() + "\n[actuators.d]\njoint = 'jl'\nstiffness = 9\n")
    with pytest.raises(FormatError, match=r"has actuators \(l, r\), so it needs no \[actuators\]"):
        load_gripper(path)
