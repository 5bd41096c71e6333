"""Hands of MuJoCo Menagerie by name, from a checkout or from the package."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.grippers.menagerie import load_menagerie_gripper, menagerie_names
from graspcast.simulation.trial.gripper_conformance import check_gripper
from jaws import write_jaws

ROOT = os.environ.get("MENAGERIE_ROOT", "")


def checkout(folder: Path) -> Path:
    """A checkout whose 2F-85 is two jaws on one drive."""
    hand = folder / "robotiq_2f85"
    write_jaws(hand, x=0, more='<equality><joint joint1="jl" joint2="jr"/></equality>')
    mjcf = (hand / "jaws.xml").read_text().splitlines()
    text = "\n".join(line for line in mjcf if '<position name="r"' not in line)
    text = text.replace('<site name="tcp"', '<body name="base"/><site name="tcp"')
    text = text.replace('name="l" joint="jl"', 'name="fingers_actuator" joint="jl"')
    (hand / "2f85.xml").write_text(text.replace('ctrlrange="0 0.05"', 'ctrlrange="0 255"'))
    return folder


class AbsentError(Exception):
    """What the package raises if it cannot download."""


def package(path: Path | None) -> ModuleType:
    def find(progress: object) -> Path:
        if path is None:
            raise AbsentError("Name or service not known")
        return path

    module = ModuleType("mujoco_menagerie")
    module.MenagerieError = AbsentError  # type: ignore[attr-defined]
    module.get = lambda robot: SimpleNamespace(path=find)  # type: ignore[attr-defined]
    return module


def test_a_hand_from_a_checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MENAGERIE_ROOT", str(checkout(tmp_path)))
    hand = load_gripper("robotiq_2f85")
    assert hand.name == "robotiq_2f85"
    assert hand.max_opening_m == pytest.approx(0.085)
    assert hand.base_T_tcp[:3, 3] == pytest.approx([0, 0, 0.136])
    # Closing is along y of the hand.
    assert hand.base_T_tcp[:3, 0] == pytest.approx([0, 1, 0], abs=1e-7)
    assert dict(hand.closing.close) == {"fingers_actuator": 255.0}


def test_a_hand_from_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    folder = checkout(tmp_path) / "robotiq_2f85"
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", package(folder))
    assert load_menagerie_gripper("robotiq_2f85").model == folder / "2f85.xml"


def test_offline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", package(None))
    with pytest.raises(InputError, match=r"not known\).*mujoco-menagerie prefetch robotiq_2f85"):
        load_gripper("robotiq_2f85")


def test_without_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MENAGERIE_ROOT", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco_menagerie", None)
    with pytest.raises(InputError, match=r"--no-deps mujoco-menagerie .*MENAGERIE_ROOT"):
        load_gripper("robotiq_2f85")


def test_a_checkout_of_something_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MENAGERIE_ROOT", str(tmp_path))
    with pytest.raises(InputError, match=r"2f85.xml.*no such file.*is MENAGERIE_ROOT a checkout"):
        load_gripper("robotiq_2f85")


def test_names() -> None:
    assert "robotiq_2f85" in menagerie_names()
    with pytest.raises(UnknownNameError, match="did you mean 'robotiq_2f85'"):
        load_gripper("robotiq_2f58")


def test_a_custom_gripper_has_another_name(tmp_path: Path) -> None:
    path = write_jaws(tmp_path)
    path.write_text(path.read_text().replace('"jaws"', '"robotiq_2f85"'))
    with pytest.raises(FormatError, match="that of a built-in gripper"):
        load_gripper(path)


@pytest.mark.skipif(
    not Path(ROOT, "robotiq_2f85").is_dir(),
    reason="needs a checkout of MuJoCo Menagerie, named by MENAGERIE_ROOT",
)
def test_the_real_2f85_is_what_its_description_says() -> None:
    report = check_gripper(load_gripper("robotiq_2f85"))
    assert report.passed, str(report)
    assert report.measured is not None
    # 85 mm by its data sheet.
    assert report.measured.opening_m == pytest.approx(0.085, abs=1e-3)
    assert report.measured.gap_m == pytest.approx([0, 0, 0], abs=2e-3)
