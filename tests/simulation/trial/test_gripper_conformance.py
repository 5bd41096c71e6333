from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from graspcast.pose.transforms import transform
from graspcast.simulation.grippers import GRIPPERS, FrankaHand, load_gripper
from graspcast.simulation.grippers.protocol import Closing
from graspcast.simulation.trial.gripper_conformance import check_gripper

THREE_JAW = Path(__file__).parents[2] / "data" / "three_jaw.toml"


@pytest.mark.parametrize("name", [*GRIPPERS, THREE_JAW], ids=str)
def test_the_built_in_hands_and_a_foreign_one_pass(name: str | Path) -> None:
    report = check_gripper(load_gripper(name))
    assert report.passed, str(report)
    assert len(report.checks) == 12
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
    spec.actuators[0].forcerange = (-0.3, 0.3)


_steps = itertools.count()


def drifting(spec: Any) -> None:
    for geom in spec.geoms:
        geom.size[0] += 1e-5 * next(_steps)


_ONE_SPEC = FrankaHand().spec()

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
        ("holds", {"base_T_tcp": _BACKWARDS}, "Is the TCP between"),
        ("holds", {"spec": model(weak)}, "dropped"),
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
