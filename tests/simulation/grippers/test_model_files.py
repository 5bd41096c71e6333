"""Model files of hands: their base, and what may be in them."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from graspcast.errors import FormatError
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.grippers.model_files import load_model
from graspcast.simulation.trial.gripper_measurement import measure_gripper
from jaws import write_jaws

SLIDES = '<joint name="up" type="slide" axis="0 0 1"/><joint name="turn" axis="0 0 1"/>'


@pytest.mark.parametrize("root", ["hand", ""])
@pytest.mark.parametrize("joints", ["<freejoint/>", SLIDES])
def test_joints_of_a_floating_base_do_not_count(root: str, joints: str, tmp_path: Path) -> None:
    gripper = load_gripper(write_jaws(tmp_path, root=root, joints=joints))
    model = gripper.spec().compile()
    assert [model.joint(i).name for i in range(model.njnt)] == ["jl", "jr"]
    count = joints.count("joint")
    assert gripper.notes == (  # type: ignore[attr-defined]
        f"the arm carries the base {root!r}, so its {count} joint(s) do not count",
    )
    found = measure_gripper(gripper)
    assert found is not None
    assert found.opening_m == pytest.approx(0.094, abs=2e-4)


def test_what_drives_a_floating_base_does_not_count_either(tmp_path: Path) -> None:
    more = """<actuator><position name="lift" joint="up" kp="100"/></actuator>
      <sensor><jointpos joint="up"/></sensor>
      <keyframe><key name="wide" qpos="0.5 0 0.045 0.045" ctrl="0.045 0.045 0.5"/></keyframe>"""
    path = write_jaws(tmp_path, joints=SLIDES, more=more, open='"wide"')
    gripper = load_gripper(path)
    assert dict(gripper.closing.open) == {"l": 0.045, "r": 0.045}
    assert "nor the actuators lift" in gripper.notes[0]  # type: ignore[attr-defined]


def test_a_root_that_is_the_only_moving_part_is_no_base(tmp_path: Path) -> None:
    (tmp_path / "a.xml").write_text(
        '<mujoco><worldbody><body name="b"><joint/><geom size="0.1"/></body></worldbody></mujoco>'
    )
    with pytest.raises(FormatError, match="no joint but 1 of its root body 'b'"):
        load_model(tmp_path / "a.xml")


def test_several_roots_and_none(tmp_path: Path) -> None:
    body = '<body name="{}"><geom size="0.1"/></body>'
    for bodies, said in (([], "it has none"), (["a", "b"], "it has 'a', 'b'")):
        (tmp_path / "a.xml").write_text(
            f"<mujoco><worldbody>{''.join(map(body.format, bodies))}</worldbody></mujoco>"
        )
        with pytest.raises(FormatError, match=said):
            load_model(tmp_path / "a.xml")


def test_a_hand_without_joints_of_its_base_is_as_in_its_file(tmp_path: Path) -> None:
    write_jaws(tmp_path)
    spec = mujoco.MjSpec.from_file(str(tmp_path / "jaws.xml"))
    assert load_model(tmp_path / "jaws.xml").to_xml() == spec.to_xml()
