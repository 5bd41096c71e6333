from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.simulation.engine import mujoco
from graspcast.simulation.grippers import FrankaHand, load_gripper
from graspcast.simulation.grippers.protocol import Closing
from graspcast.simulation.mujoco_version import release_of
from graspcast.simulation.trial.gripper_conformance import check_gripper
from jaws import Y, write_jaws

THREE_JAW = Path(__file__).parents[2] / "data" / "three_jaw.toml"


def slow(*values: object) -> Any:
    return pytest.param(*values, marks=pytest.mark.slow)


@pytest.mark.parametrize("name", ["parallel", slow("underactuated"), slow(THREE_JAW)], ids=str)
def test_the_built_in_hands_and_a_foreign_one_pass(name: str | Path) -> None:
    report = check_gripper(load_gripper(name))
    assert report.passed, str(report)
    assert len(report.checks) == 15
    assert report.failures == ()


@dataclass
class Altered:
    """A gripper that is another one but for some attributes."""

    like: Any
    changes: dict[str, Any]

    def __getattr__(self, name: str) -> Any:
        changes = self.__dict__["changes"]
        return changes[name] if name in changes else getattr(self.__dict__["like"], name)


def model(change: Callable[[Any], None]) -> Callable[[], Any]:
    def spec() -> Any:
        fresh = FrankaHand().spec()
        change(fresh)
        return fresh

    return spec


def no_contact(spec: Any) -> None:
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0


def two_roots(spec: Any) -> None:
    spec.worldbody.add_body(name="camera")


def unlimited(spec: Any) -> None:
    spec.actuators[0].forcelimited = False
    spec.actuators[0].set_to_position(kp=5e4)
    for joint in spec.joints:
        joint.armature = 10.0


def crushing(spec: Any) -> None:
    spec.actuators[0].forcelimited = False
    spec.actuators[0].set_to_position(kp=3e5)


def explosive(spec: Any) -> None:
    spec.actuators[0].forcelimited = False
    spec.actuators[0].set_to_position(kp=1e9, kv=0.0)


def undamped(spec: Any) -> None:
    spec.actuators[0].set_to_position(kp=1e4, kv=-1.0)
    spec.actuators[0].forcelimited = False
    for joint in spec.joints:
        joint.limited, joint.damping = False, (0, 0, 0)


def weak(spec: Any) -> None:
    """Too weak to open."""
    spec.actuators[0].forcerange = (-0.3, 0.3)
    for joint in spec.joints:
        joint.damping = (5, 0, 0)


def unnamed(spec: Any) -> None:
    spec.actuators[0].name = ""


def with_options(spec: Any) -> None:
    spec.option.timestep, spec.option.impratio = 0.0005, 10


def _turned(vector: tuple[float, ...]) -> np.ndarray:
    return transform(rotation_from_vector(np.array(vector)), np.zeros(3))


_steps = itertools.count()


def drifting(spec: Any) -> None:
    for geom in spec.geoms:
        geom.size[0] += 1e-5 * next(_steps)


_ONE_SPEC = FrankaHand().spec()

_TCP = FrankaHand().base_T_tcp
_QUARTER, _OBLIQUE = (_TCP @ _turned((0, 0, angle)) for angle in (np.pi / 2, np.pi / 4))
_OFF = _TCP @ transform(np.eye(3), np.array([0.01, 0, 0]))
_SIDEWAYS = _TCP @ _turned((0, np.pi / 2, 0))
_BACKWARDS = _TCP @ np.diag([1.0, -1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("check", "changes", "message"),
    [
        ("describes", {"max_opening_m": 0.0}, "must be > 0"),
        ("describes", {"base_T_tcp": np.zeros((4, 4))}, "rigid"),
        ("compiles", {"spec": lambda: _ONE_SPEC}, "same object twice"),
        ("compiles", {"spec": model(two_roots)}, "one root body"),
        ("actuators", {"closing": Closing({"motor": 1.0}, {"motor": 0.0}, 1.0)}, "fingers"),
        ("touches", {"spec": model(no_contact)}, "no geom collides"),
        slow("opens", {"spec": model(undamped)}, "damping"),
        ("opens", {"spec": model(explosive)}, "unstable within 1 s"),
        ("closes", {"closing": Closing({"fingers": 0.08}, {"fingers": 0.08}, 1.0)}, "no joint"),
        ("compiles", {"max_opening_m": 80.0}, "is it in millimetres (80 mm)"),
        ("actuators", {"spec": model(unnamed)}, "has no name"),
        ("aligned", {"base_T_tcp": _QUARTER}, "along y of the TCP, not along x"),
        slow("aligned", {"base_T_tcp": _OBLIQUE}, "at 45° to x of the TCP"),
        slow("aligned", {"base_T_tcp": _SIDEWAYS}, "along z of the TCP"),
        slow("aligned", {"base_T_tcp": _BACKWARDS}, "z of the TCP is 180° off"),
        slow(
            "centred",
            {"base_T_tcp": _OFF},
            "the gap between the fingers is 10.0 mm off",
        ),
        (
            "holds",
            {"spec": model(weak)},
            "weak grip: the fingers press with 0.3 N a side, and 1.8 N are needed",
        ),
        slow("solid", {"spec": model(crushing)}, "limit its actuators"),
        slow("drops", {"spec": model(unlimited)}, "force limit"),
        slow("repeats", {"spec": model(drifting)}, "depend on anything"),
    ],
)
def test_a_broken_gripper_fails_at_the_check_that_names_its_fault(
    check: str, changes: dict[str, Any], message: str
) -> None:
    report = check_gripper(Altered(FrankaHand(), changes))
    assert not report.passed
    found = {failure.name: failure.detail for failure in report.failures}
    assert check in found, str(report)
    assert message in found[check]
    assert f"FAIL {check}" in str(report)


@pytest.mark.ill_typed
def test_something_that_is_no_gripper_at_all_is_told_what_it_lacks() -> None:
    report = check_gripper(SimpleNamespace(name="spoon"))  # type: ignore[arg-type]
    assert [c.name for c in report.failures] == ["describes"]
    assert "base_T_tcp, closing, equilibrium" in report.failures[0].detail


@pytest.mark.slow
def test_options_of_the_hand_are_said_not_to_count(recwarn: pytest.WarningsRecorder) -> None:
    report = check_gripper(Altered(FrankaHand(), {"spec": model(with_options)}))
    (compiles,) = (check for check in report.checks if check.name == "compiles")
    assert "its own option (timestep 0.0005, impratio 10) does not count" in compiles.detail
    assert not recwarn.list


@pytest.mark.slow
def test_the_force_of_the_fingers_is_that_of_the_drive() -> None:
    report = check_gripper(FrankaHand())
    assert report.measured is not None
    assert report.measured.grip_n == pytest.approx(60, rel=0.02)
    (holds,) = (c for c in report.checks if c.name == "holds")
    assert f"the fingers press with {report.measured.grip_n:.1f} N a side" in holds.detail


@pytest.mark.slow
def test_a_servo_that_does_not_saturate_presses_as_its_stiffness_says(tmp_path: Path) -> None:
    report = check_gripper(load_gripper(write_jaws(tmp_path, kp=60, damping=6)))
    (holds,) = report.failures
    assert holds.name == "holds"
    assert "weak grip: the fingers press with 1.3 N a side, and 1.8 N are needed" in holds.detail
    assert report.measured is not None
    # On half of the opening, 47 mm, each joint is 21.5 mm from its command.
    assert report.measured.grip_n == pytest.approx(60 * 0.0215, rel=0.02)


@pytest.mark.slow
def test_what_does_not_depend_on_the_tcp_is_checked_with_the_measured_one(tmp_path: Path) -> None:
    report = check_gripper(load_gripper(write_jaws(tmp_path, quat=Y, x=0.02)))
    assert [c.name for c in report.failures] == ["aligned", "centred"], str(report)
    assert "the gap's centre is at" in report.failures[1].detail
    (holds,) = (c for c in report.checks if c.name == "holds")
    assert "40.0 N a side, with the measured TCP" in holds.detail


@pytest.mark.slow
@pytest.mark.skipif(
    release_of(mujoco.__version__) < (3, 12), reason="MuJoCo before 3.12 makes no such remark"
)
def test_remarks_of_mujoco_on_the_hand_are_notes(tmp_path: Path) -> None:
    report = check_gripper(load_gripper(write_jaws(tmp_path, more='<option timestep="0.0005"/>')))
    assert report.passed
    assert any("timestep: parent has 0.002 (default), child has 0.0005" in n for n in report.notes)


def test_after_a_hand_that_does_not_close_nothing_more_is_tried(tmp_path: Path) -> None:
    outwards = {"open": "{ l = 0.0, r = 0.0 }", "close": "{ l = 0.045, r = 0.045 }"}
    report = check_gripper(load_gripper(write_jaws(tmp_path, **outwards)))
    assert report.checks[-1].name == "closes"
    assert "closes outwards" in report.checks[-1].detail
    assert report.measured is None


def test_a_hand_that_is_unstable_as_it_closes(tmp_path: Path) -> None:
    path = write_jaws(tmp_path, open="{ l = 0.0, r = 0.045 }", close="{ l = -1.0, r = 0.0 }")
    servo = '<position name="l" joint="jl" kp="3000" forcerange="-40 40" ctrlrange="0 0.05"/>'
    mjcf = (tmp_path / "jaws.xml").read_text()
    assert servo in mjcf
    mjcf = mjcf.replace(servo, '<motor name="l" joint="jl" gear="1e9"/>')
    (tmp_path / "jaws.xml").write_text(mjcf.replace(' range="-0.001 0.05"', ""))
    report = check_gripper(load_gripper(path))
    assert report.checks[-1].name == "closes"
    assert "the closing hand is unstable" in report.checks[-1].detail
