"""Grippers: the Franka Hand's mechanics, a foreign hand from MJCF, and what check_gripper finds."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.pose.transforms import transform
from graspcast.simulation.grippers import GRIPPERS, FrankaHand, TendonHand, load_gripper
from graspcast.simulation.grippers.protocol import Closing, Equilibrium, Gripper, gripper_digest
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.gripper_conformance import check_gripper
from graspcast.simulation.trial.trial import TrialRunner
from solids import IDENTITY, box, from_above

THREE_JAW = Path(__file__).parents[2] / "data" / "three_jaw.toml"


# The Franka Hand


@pytest.mark.parametrize("grip_n", [30.0, 60.0])
def test_each_finger_of_the_franka_hand_presses_with_the_set_force(grip_n: float) -> None:
    target = box(0.05, 0.06, 0.08)
    runner = TrialRunner(target, FrankaHand(grip_n=grip_n))
    scene, force = runner.scene, np.zeros(6)
    sums: list[dict[str, float]] = []

    def watch(model: mujoco.MjModel, data: mujoco.MjData, phase: str) -> None:
        totals = {"hand/left_pad": 0.0, "hand/right_pad": 0.0}
        for k in range(data.ncon):
            names = {model.geom(int(g)).name for g in data.contact.geom[k]}
            for pad in names & totals.keys():
                mujoco.mj_contactForce(model, data, k, force)
                totals[pad] += force[0]
        sums.append(totals)

    outcome = runner.run(IDENTITY, Grasp(from_above(target, 0.02), "box", "parallel"), record=watch)
    assert outcome.success
    for pad in ("hand/left_pad", "hand/right_pad"):
        assert sums[-1][pad] == pytest.approx(grip_n, rel=0.05)
    assert scene.data.actuator("hand/fingers").force[0] == pytest.approx(-grip_n)


def test_both_fingers_of_the_franka_hand_move_together_at_the_set_speed() -> None:
    runner = TrialRunner(box(), FrankaHand())
    course: list[tuple[float, float, float]] = []

    def watch(model: mujoco.MjModel, data: mujoco.MjData, phase: str) -> None:
        if phase == "close":
            left, right = (data.joint(f"hand/{side}").qpos[0] for side in ("left", "right"))
            course.append((data.time, left, right))

    # 10 cm too high: the fingers close on nothing.
    runner.run(
        IDENTITY, Grasp(from_above(box(), 0.13), "box", "parallel"), early_stop=False, record=watch
    )
    times, left, right = np.array(course).T
    np.testing.assert_allclose(left, right, atol=1e-4)
    under_way = (left < 0.035) & (left > 0.005)
    speed = np.polyfit(times[under_way], left[under_way], 1)[0]
    assert speed == pytest.approx(-0.05, rel=0.02)
    assert left[-1] == pytest.approx(0.0, abs=5e-4)


def test_the_franka_hand_centres_what_it_grips_off_centre() -> None:
    target = box(0.04, 0.04, 0.05)
    runner = TrialRunner(target, FrankaHand())
    grasp = Grasp(from_above(target, 0.0), "box", "parallel")
    outcome = runner.run(transform(np.eye(3), np.array([0.015, 0, 0])), grasp)
    assert outcome.success
    assert runner.scene.centroid_in_base()[1] == pytest.approx(0.0, abs=1e-3)


def test_the_franka_hand_grips_within_its_manual() -> None:
    for force in (10.0, 140.0):
        with pytest.raises(InputError, match="30 to 70 N"):
            FrankaHand(grip_n=force)


def test_an_object_wider_than_the_stroke_cannot_be_held() -> None:
    target = box(0.09, 0.09, 0.09)
    runner = TrialRunner(target, FrankaHand())
    outcome = runner.run(IDENTITY, Grasp(from_above(target, 0.02), "box", "parallel"))
    assert not outcome.success


# Names and files


def test_grippers_are_loaded_by_name_or_by_file() -> None:
    assert {name: type(load_gripper(name)) for name in GRIPPERS} == {
        "parallel": FrankaHand,
        "underactuated": TendonHand,
    }
    assert load_gripper(THREE_JAW).name == "three_jaw"
    with pytest.raises(UnknownNameError, match=r"'frank'.*did you mean 'franka'.*\.toml"):
        load_gripper("frank")


def test_every_gripper_satisfies_the_protocol() -> None:
    for name in (*GRIPPERS, THREE_JAW):
        assert isinstance(load_gripper(name), Gripper)


def test_the_tool_centre_point_of_a_foreign_hand_is_in_its_base_frame() -> None:
    # The site sits 55 mm along -y of the base; z of the site is -y, x is z of the base.
    expected = transform(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([0, -0.055, 0]))
    np.testing.assert_allclose(load_gripper(THREE_JAW).base_T_tcp, expected, atol=1e-9)


def test_digests_follow_the_model_and_the_commands() -> None:
    hands = [
        FrankaHand(),
        FrankaHand(grip_n=50.0),
        FrankaHand(finger_speed=0.04),
        TendonHand(),
        TendonHand(pulleys_m=(0.010, 0.005)),
        load_gripper(THREE_JAW),
        replace(load_gripper(THREE_JAW), equilibrium=Equilibrium(limit_s=1.0)),
    ]
    assert len({gripper_digest(hand) for hand in hands}) == len(hands)
    assert gripper_digest(FrankaHand()) == gripper_digest(FrankaHand())


TOML = THREE_JAW.read_text()
MJCF = (THREE_JAW.parent / "three_jaw.xml").read_text()


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("toml", "mjcf", "error", "message"),
    [
        (("a = 0.0,", "drive = 0.0,"), None, FormatError, "both must name the same ones"),
        (
            ("", ""),
            ('<position name="a"', '<position name="x"'),
            UnknownNameError,
            "known: x, b, c",
        ),
        (("", ""), ("</actuator>", '<motor name="d" joint="a"/></actuator>'), FormatError, "of d"),
        (('"grasp"', '"tcp"'), None, UnknownNameError, r"unknown site 'tcp'.*known: grasp"),
        (('"three_jaw.xml"', '"hand.xml"'), None, InputError, "no such file"),
        (("name =", "nome ="), None, UnknownNameError, r"unknown key 'nome'.*'name'"),
        (("max_opening_m = 0.09\n", ""), None, FormatError, "lacks max_opening_m"),
        (("0.09", "-1"), None, FormatError, "max_opening_m: must be a number above zero"),
        (("seconds = 0.6", "seconds = 0"), None, FormatError, "closing takes 0 s"),
        (("seconds = 0.6", "second = 0.6"), None, FormatError, r"\[closing\].*it may hold open"),
        (("[closing]", "[closing"), None, FormatError, "is not TOML"),
        (("[closing]", "[equilibrium]\nlimit = 1\n[closing]"), None, FormatError, "equilibrium"),
        (
            ("", ""),
            ('<body name="chuck"', '<body name="x"/><body name="chuck"'),
            FormatError,
            "one",
        ),
        (("", ""), ("<light", "<freejoint/><light"), FormatError, "not MJCF"),
        (
            ("", ""),
            ('<site name="grasp"', '<freejoint/><site name="grasp"'),
            FormatError,
            r"'chuck' \(with a joint\)",
        ),
        (("", ""), ('joint="b" kp', 'joint="z" kp'), FormatError, "does not compile"),
    ],
)
def test_a_wrong_description_is_explained(
    toml: tuple[str, str],
    mjcf: tuple[str, str] | None,
    error: type[Exception],
    message: str,
    tmp_path: Path,
) -> None:
    assert toml[0] in TOML
    (tmp_path / "three_jaw.toml").write_text(TOML.replace(*toml, 1))
    old, new = mjcf or ("", "")
    assert old in MJCF
    (tmp_path / "three_jaw.xml").write_text(MJCF.replace(old, new, 1))
    with pytest.raises(error, match=message):
        load_gripper(tmp_path / "three_jaw.toml")


# Conformance


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
        ("compiles", {"spec": lambda: _ONE_SPEC}, "fresh"),
        ("compiles", {"spec": model(two_roots)}, "one root body"),
        ("actuators", {"closing": Closing({"motor": 1.0}, {"motor": 0.0}, 1.0)}, "fingers"),
        ("touches", {"spec": model(no_contact)}, "no geom collides"),
        ("opens", {"spec": model(undamped)}, "damping"),
        ("opens", {"spec": model(explosive)}, "blow up within 1 s"),
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
