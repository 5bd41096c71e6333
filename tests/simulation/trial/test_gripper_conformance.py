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
from graspcast.simulation.grippers import GRIPPERS, FrankaHand, load_gripper
from graspcast.simulation.grippers.protocol import Closing
from graspcast.simulation.trial.gripper_conformance import check_gripper

THREE_JAW = Path(__file__).parents[2] / "data" / "three_jaw.toml"


@pytest.mark.parametrize("name", [*GRIPPERS, THREE_JAW], ids=str)
def test_the_built_in_hands_and_a_foreign_one_pass(name: str | Path) -> None:
    report = check_gripper(load_gripper(name))
    assert report.passed, str(report)
    assert len(report.checks) == 13
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
_SIDEWAYS = _TCP @ _turned((0, np.pi / 2, 0))
_BACKWARDS = transform(np.diag([1.0, -1.0, -1.0]), np.array([0, 0, 0.1034]))


@pytest.mark.parametrize(
    ("check", "changes", "message"),
    [
        ("describes", {"max_opening_m": 0.0}, "must be > 0"),
        ("describes", {"base_T_tcp": np.zeros((4, 4))}, "rigid"),
        ("compiles", {"spec": lambda: _ONE_SPEC}, "same object twice"),
        ("compiles", {"spec": model(two_roots)}, "one root body"),
        ("actuators", {"closing": Closing({"motor": 1.0}, {"motor": 0.0}, 1.0)}, "fingers"),
        ("touches", {"spec": model(no_contact)}, "no geom collides"),
        ("opens", {"spec": model(undamped)}, "damping"),
        ("opens", {"spec": model(explosive)}, "unstable within 1 s"),
        ("closes", {"closing": Closing({"fingers": 0.08}, {"fingers": 0.08}, 1.0)}, "no joint"),
        ("compiles", {"max_opening_m": 80.0}, "is it in millimetres (80 mm)"),
        ("actuators", {"spec": model(unnamed)}, "has no name"),
        ("aligned", {"base_T_tcp": _QUARTER}, "along y of the TCP, not along x"),
        ("aligned", {"base_T_tcp": _OBLIQUE}, "at 45° to x of the TCP"),
        ("aligned", {"base_T_tcp": _SIDEWAYS}, "along z of the TCP"),
        ("holds", {"base_T_tcp": _BACKWARDS}, "Is the TCP between"),
        ("holds", {"spec": model(weak)}, "N, on the way to a column of 40 mm: does it open"),
        ("solid", {"spec": model(crushing)}, "limit its actuators"),
        ("drops", {"spec": model(unlimited)}, "force limit"),
        ("repeats", {"spec": model(drifting)}, "depend on anything"),
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


def test_options_of_the_hand_are_said_not_to_count(recwarn: pytest.WarningsRecorder) -> None:
    report = check_gripper(Altered(FrankaHand(), {"spec": model(with_options)}))
    (compiles,) = (check for check in report.checks if check.name == "compiles")
    assert "its own option (timestep 0.0005, impratio 10) does not count" in compiles.detail
    assert not recwarn.list


def test_the_force_of_the_fingers_is_told() -> None:
    (holds,) = (c for c in check_gripper(FrankaHand()).checks if c.name == "holds")
    force = float(holds.detail.split("press with ")[1].split(" N")[0])
    # The drive saturates at the grip force of each finger, and 2 x 30 N is the hand's least.
    assert 30 < force < 70
