"""The tendon hand's mechanics against closed forms, and what it can hold and cannot."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.pose.transforms import transform
from graspcast.simulation.grippers import TendonHand
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.trial import TrialRunner
from solids import IDENTITY, box, cylinder, from_above, sphere

DIGITS = ("thumb", "upper", "lower")


BLOCKED_AT, POST_RADIUS = 0.35, 0.004


def _touching(hand: TendonHand, angle: float, *, along: float, post: float) -> tuple[float, float]:
    """Where a post across touches the inside of a finger's proximal link at an angle."""
    out = np.array([-np.sin(angle), -np.cos(angle)])
    inwards = np.array([-np.cos(angle), np.sin(angle)])
    base = np.array([hand.base_gap_m / 2, 0.0])
    x, z = base + along * out + (hand.radius_m + post) * inwards
    return float(x), float(z)


class Bench:
    """The hand alone, fixed in space, without gravity; optionally with posts in its way."""

    def __init__(self, hand: TendonHand | None = None, *, posts: bool = False):
        self.hand = hand or TendonHand()
        spec = self.hand.spec()
        spec.option.gravity = (0, 0, 0)
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        for geom in spec.geoms:
            geom.contype, geom.conaffinity = 1, 2
        if posts:
            # One across in front of the proximal links, which touch it 22 mm from their joint.
            x, z = _touching(self.hand, BLOCKED_AT, along=0.022, post=POST_RADIUS)
            for sign in (-1.0, 1.0):
                spec.worldbody.add_geom(
                    name=f"post{sign:+.0f}",
                    type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                    fromto=(sign * x, -0.06, z, sign * x, 0.06, z),
                    size=(POST_RADIUS, 0, 0),
                    contype=2,
                    conaffinity=1,
                )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        for digit in DIGITS:
            for part, angle in zip(("proximal", "distal"), self.hand.open_rad, strict=True):
                self.data.joint(f"{digit}_{part}").qpos = angle
        mujoco.mj_forward(self.model, self.data)

    def wind(self, start: float, end: float, seconds: float) -> list[np.ndarray]:
        """Ramp the motor's command; the angles [digit, proximal or distal] every 10 ms."""
        seen = []
        for command in np.linspace(start, end, round(seconds / 0.01)):
            self.data.ctrl[0] = command
            mujoco.mj_step(self.model, self.data, nstep=5)
            seen.append(self.angles())
        return seen

    def angles(self) -> np.ndarray:
        return np.array(
            [[self.data.joint(f"{d}_{p}").qpos[0] for p in ("proximal", "distal")] for d in DIGITS]
        )

    def tensions(self) -> np.ndarray:
        """From the elongation of each tendon, in the order of DIGITS."""
        rest = -float(np.dot(self.hand.pulleys_m, self.hand.open_rad))
        lengths = np.array([self.data.tendon(d).length[0] for d in DIGITS])
        return self.hand.tendon_stiffness * np.maximum(lengths - rest, 0.0)


def test_without_a_command_every_joint_is_at_its_open_stop_and_no_tendon_pulls() -> None:
    bench = Bench()
    bench.wind(0.0, 0.0, 1.0)
    np.testing.assert_allclose(bench.angles(), 3 * [bench.hand.open_rad], atol=2e-3)
    np.testing.assert_allclose(bench.tensions(), 0.0, atol=0.05)


def test_free_closing_flexes_the_proximal_joint_first_then_both_in_the_designed_ratio() -> None:
    bench = Bench()
    path = np.array(bench.wind(0.0, bench.hand.travel_m, 8.0))
    np.testing.assert_allclose(path[:, 1], path[:, 2], atol=1e-6)
    moved = path - np.array(bench.hand.open_rad)
    for digit in range(3):
        first = moved[moved[:, digit, 1] < 2e-3][-1]
        assert first[digit, 0] > 0.1, "the proximal joint leaves its stop before the distal one"
        both = (moved[:, digit, 1] > 0.1) & (moved[:, digit, 0] < 1.5)
        slope = np.polyfit(moved[both, digit, 0], moved[both, digit, 1], 1)[0]
        hand = bench.hand
        design = hand.pulleys_m[1] / hand.pulleys_m[0] * hand.springs[0] / hand.springs[1]
        assert slope == pytest.approx(design, rel=0.05)


def test_a_blocked_proximal_joint_stalls_and_the_distal_one_goes_on_to_its_stop() -> None:
    command = 0.0199
    free, blocked = Bench(), Bench(posts=True)
    for bench in (free, blocked):
        bench.wind(0.0, command, 0.8)
        bench.wind(command, command, 2.0)
    # Free: springs balance the tension T, and the command is spent on servo, tendon and joints.
    hand = free.hand
    radii, springs, preload = map(np.array, (hand.pulleys_m, hand.springs, hand.preload))
    softness = 3 / hand.motor_stiffness + 1 / hand.tendon_stiffness + np.sum(radii**2 / springs)
    tension = (command + np.sum(radii * preload / springs)) / softness
    expected = np.array(hand.open_rad) + (radii * tension - preload) / springs
    np.testing.assert_allclose(expected, [0.87, 0.77], atol=0.01)
    np.testing.assert_allclose(free.angles(), 3 * [expected], atol=2e-3)
    np.testing.assert_allclose(blocked.angles()[:, 0], BLOCKED_AT, atol=0.02)
    np.testing.assert_allclose(blocked.angles()[:, 1], blocked.hand.closed_rad[1], atol=0.02)


@pytest.mark.parametrize("posts", [False, True])
def test_joint_torques_follow_from_the_tensions_which_add_up_to_the_motor(posts: bool) -> None:
    bench = Bench(posts=posts)
    hand = bench.hand
    for level in (0.010, 0.020, hand.travel_m):
        bench.wind(level - 0.01, level, 0.5)
        bench.wind(level, level, 3.0)
        mujoco.mj_forward(bench.model, bench.data)
        tensions = bench.tensions()
        for digit, angles, tension in zip(DIGITS, bench.angles(), tensions, strict=True):
            for k, part in enumerate(("proximal", "distal")):
                dof = bench.data.joint(f"{digit}_{part}")
                spring = hand.springs[k] * (angles[k] - hand.open_rad[k]) + hand.preload[k]
                expected = hand.pulleys_m[k] * tension - spring - hand.damping * dof.qvel[0]
                assert dof.qfrc_passive[0] == pytest.approx(expected, abs=1e-3)
                # At rest, what the tendon and the springs leave is what a stop or a post takes.
                assert dof.qfrc_constraint[0] == pytest.approx(-expected, abs=1e-3)
        assert tensions.sum() == pytest.approx(bench.data.actuator_force[0], abs=0.1)
    # With nothing in the way the joints stop, 25.6 mm into the 30 mm, short of the motor's limit.
    at_stops = np.dot(hand.pulleys_m, np.subtract(hand.closed_rad, hand.open_rad))
    stretched = (hand.travel_m - at_stops) / (3 / hand.motor_stiffness + 1 / hand.tendon_stiffness)
    expected = hand.motor_n if posts else 3 * stretched
    assert tensions.sum() == pytest.approx(expected, rel=0.01)


def test_released_the_hand_reopens_within_a_second_and_no_tendon_ever_pushes() -> None:
    bench = Bench()
    bench.wind(0.0, bench.hand.travel_m, 0.8)
    bench.wind(bench.hand.travel_m, bench.hand.travel_m, 1.0)
    hand, data = bench.hand, bench.data
    dofs = [bench.model.joint(f"{d}_proximal").dofadr[0] for d in DIGITS]
    pulls = []
    data.ctrl[0] = 0.0
    for _ in range(500):
        before = bench.angles()[:, 0]
        mujoco.mj_step(bench.model, data)
        # All elastic torque on the proximal joints, less that of their own springs.
        own = -hand.springs[0] * (before - hand.open_rad[0]) - hand.preload[0]
        pulls.append((data.qfrc_spring[dofs] - own) / hand.pulleys_m[0])
    np.testing.assert_allclose(bench.angles(), 3 * [hand.open_rad], atol=5e-3)
    assert np.max(pulls) > 1.0, "the tendons did pull before they were released"
    assert np.min(pulls) > -1e-9


TARGETS = {
    "cylinder upright": (cylinder(), 0.01),
    "cylinder lying": (cylinder(lying=True), 0.0),
    "cube": (box(), 0.0),
    "sphere": (sphere(), 0.005),
}


def _hold(target: GraspObject, height: float) -> tuple[TrialRunner, Grasp]:
    grasp = from_above(target, height, along_y=bool(target.sim_T_ref[0, 2]))
    return TrialRunner(target, TendonHand()), Grasp(grasp, target.name, "underactuated")


@pytest.mark.slow
@pytest.mark.parametrize("mass_kg", [0.35, 1.0])
@pytest.mark.parametrize("what", TARGETS)
def test_it_holds_what_the_published_hand_holds_without_creep(what: str, mass_kg: float) -> None:
    target, height = TARGETS[what]
    heavier = mass_kg / target.mass_kg
    target = replace(target, mass_kg=mass_kg, inertia=heavier * target.inertia)
    runner, grasp = _hold(target, height)
    course: list[tuple[float, np.ndarray]] = []

    def record(model: object, data: mujoco.MjData, phase: str) -> None:
        if phase == "lift":
            course.append((data.time, runner.scene.centroid_in_base()))

    outcome = runner.run(IDENTITY, grasp, early_stop=False, record=record)
    assert outcome.reason == "held"
    late = [(t, offset) for t, offset in course if t > course[-1][0] - 5.0]
    creep = np.linalg.norm(late[-1][1] - late[0][1]) / (late[-1][0] - late[0][0])
    assert creep < 10e-6


@pytest.mark.slow
def test_it_can_fail() -> None:
    target, height = TARGETS["cylinder upright"]
    runner, grasp = _hold(target, height)
    rng = np.random.default_rng(0)
    held = [
        runner.run(transform(np.eye(3), rng.uniform(-0.035, 0.035, size=3)), grasp).success
        for _ in range(40)
    ]
    assert 4 < sum(held) < 40


def test_its_values_are_checked() -> None:
    with pytest.raises(InputError, match="pulleys_m"):
        TendonHand(pulleys_m=(0.01, 0.0))
    with pytest.raises(InputError, match="open_rad must be below"):
        TendonHand(open_rad=(1.3, 0.2))


def test_its_opening_is_that_of_its_model() -> None:
    bench = Bench()
    data, radius = bench.data, bench.hand.radius_m
    tips = []
    for digit in ("thumb", "upper"):
        body = data.body(f"{digit}_distal")
        tips.append(body.xpos - bench.hand.links_m[1] * body.xmat.reshape(3, 3)[:, 2])
    assert tips[1][0] - tips[0][0] - 2 * radius == pytest.approx(bench.hand.max_opening_m)
