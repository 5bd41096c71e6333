"""Contact on the approach: its force against known physics, and what it ends."""

from __future__ import annotations

import json
import platform
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from graspcast.pose.transforms import transform
from graspcast.simulation.grippers import FrankaHand
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.collision import CollisionMonitor, forces_on_hand
from graspcast.simulation.trial.trial import TrialRunner, TrialSettings
from solids import IDENTITY, box, cylinder
from trials import GRIPPERS, HANDS, moved, sample, setup, timeless

RECORDED = Path(__file__).parents[2] / "data" / "paper_protocol_trials.json"
UNLIMITED = {"contact_force_n": None, "short_m": None}
UNREACHED = {"contact_force_n": 1e5, "short_m": 1.9}


def anvil() -> GraspObject:
    """A block too heavy to be moved, too wide to be grasped."""
    return replace(box(0.3, 0.3, 0.2, mass_kg=500.0), name="anvil")


def hand_weight_n(runner: TrialRunner) -> float:
    model = runner.scene.model
    return 9.81 * float(model.body_subtreemass[runner.scene.base_body])


def limited(runner: TrialRunner, limits: Mapping[str, float | None]) -> TrialRunner:
    settings = replace(runner.settings, **limits)  # type: ignore[arg-type]
    return TrialRunner(runner.grasp_object, runner.gripper, settings)


@pytest.mark.parametrize("gripper", HANDS)
@pytest.mark.parametrize("arm_force_n", [50.0, 100.0])
def test_a_hand_driven_into_a_fixed_block_presses_with_the_arm_s_force_and_its_own_weight(
    gripper: str, arm_force_n: float
) -> None:
    runner, grasp = setup(gripper, anvil(), 0.05, arm_force_n=arm_force_n, **UNREACHED)
    outcome = runner.run(IDENTITY, grasp)
    assert outcome.hit == "object"
    assert outcome.force_n == pytest.approx(arm_force_n + hand_weight_n(runner), rel=0.04)
    # The fingers of either hand reach past the grasp's centre by less than 4 cm.
    assert 0.05 < outcome.short_m < 0.09
    assert runner.run(IDENTITY, grasp, early_stop=False).force_n == outcome.force_n


@pytest.mark.parametrize("gripper", HANDS)
def test_a_hand_driven_into_the_table_says_so(gripper: str) -> None:
    runner, grasp = setup(gripper, box(0.04, 0.04, 0.02), 0.0)
    # Below the table's surface: beside the object, and where the hand cannot reach the object.
    for x, early_stop in ((0.25, True), (0.25, False), (3.0, True), (3.0, False)):
        error = moved(x=x, z=-0.05)
        outcome = runner.run(error, grasp, early_stop=early_stop)
        assert (outcome.success, outcome.reason, outcome.hit) == (False, "collided", "table")
        assert 0.03 < outcome.short_m < 0.11
        assert outcome.force_n > 40.0
        assert outcome.stop.startswith("stopped ") and "pressing the table with" in outcome.stop
    paper, _ = setup(gripper, box(0.04, 0.04, 0.02), 0.0, **UNLIMITED)
    assert paper.run(error, grasp).reason == "missed"


@pytest.mark.parametrize("gripper", HANDS)
def test_a_free_approach_meets_nothing(gripper: str) -> None:
    runner, grasp = setup(gripper, box(), contact_force_n=1e-3, short_m=1e-4)
    outcome = runner.run(IDENTITY, grasp)
    assert (outcome.reason, outcome.force_n, outcome.hit) == ("held", 0.0, None)
    assert outcome.short_m < 1e-4


@pytest.mark.parametrize("gripper", HANDS)
def test_grasps_that_are_far_too_deep_are_held_without_limits_and_collide_by_the_robot_s_protocol(
    gripper: str,
) -> None:
    robot, grasp = setup(gripper, cylinder())
    paper, _ = setup(gripper, cylinder(), **UNLIMITED)
    deep = {"parallel": (0.04, 0.06), "underactuated": (0.09, 0.1)}[gripper]
    for depth in deep:
        assert paper.run(moved(z=-depth), grasp).reason == "held"
        outcome = robot.run(moved(z=-depth), grasp)
        assert (outcome.success, outcome.reason, outcome.hit) == (False, "collided", "object")
        assert np.isnan(outcome.offset_m) and outcome.force_n > 40.0
    deeper = robot.run(moved(z=-deep[1]), grasp)
    further = deeper.short_m - robot.run(moved(z=-deep[0]), grasp).short_m
    assert further == pytest.approx(deep[1] - deep[0], abs=1e-3), "it stops at the same place"


def test_an_object_that_is_pushed_along_is_no_collision_though_it_bounces() -> None:
    # From the side, at the height of the centroid; too wide for the fingers, so they push it.
    target = box(0.06, 0.2, 0.1, mass_kg=1.0)
    side = np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]])
    grasp = Grasp(transform(side, np.zeros(3)), target.name, "parallel")
    settings = replace(TrialSettings(), hand_touches_table=False)
    runner = TrialRunner(target, FrankaHand(), settings)
    pushes = []

    def record(model: object, data: mujoco.MjData, phase: str) -> None:
        if phase == "approach" and data.time > 0:
            force = forces_on_hand(runner.scene).get("object", np.zeros(3))
            pushes.append(float(np.linalg.norm(force)))

    outcome = runner.run(IDENTITY, grasp, record=record)
    assert max(pushes) > 40.0, "single blows are above the limit"
    assert outcome.reason != "collided" and outcome.hit == "object"
    # At rest against the fingers, static friction is at most 0.8 x 9.81 N.
    assert 5.0 < outcome.force_n < 7.9 and outcome.short_m < 1e-3
    strict = replace(settings, contact_force_n=5.0)
    assert TrialRunner(target, FrankaHand(), strict).run(IDENTITY, grasp).reason == "collided"


@pytest.mark.slow
@pytest.mark.parametrize("gripper", HANDS)
def test_labels_by_any_limits_follow_from_one_trial_by_limits_that_are_not_reached(
    gripper: str,
) -> None:
    seen: Counter[str] = Counter()
    for runner, error, grasp in sample(gripper, 36):
        base = runner.settings
        watched = limited(runner, UNREACHED).run(error, grasp)
        paper = limited(runner, UNLIMITED).run(error, grasp)
        robot = runner.run(error, grasp)
        assert (watched.reason, watched.steps) == (paper.reason, paper.steps)
        limit, short = base.contact_force_n, base.short_m
        assert limit is not None and short is not None
        collides = watched.force_n > limit or watched.short_m > short
        assert robot.reason == ("collided" if collides else paper.reason)
        seen[robot.reason] += 1
    assert len(seen) > 2, seen


def test_a_blow_that_does_not_last_does_not_stop_the_arm() -> None:
    scene = setup("parallel", anvil(), 0.05)[0].scene
    scene.park()
    monitor = CollisionMonitor(scene)
    forces = iter([0.0, 300.0, 300.0, 300.0, 300.0, 0.0, *7 * [50.0]])
    stops = []
    for k, force in enumerate(forces):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(
                "graspcast.simulation.trial.collision.forces_on_hand",
                lambda _, f=force: {"object": np.array([0.0, 0.0, f])},
            )
            stops.append(monitor.should_stop(0.01 * (k + 1)))
    # 50 ms from the first of seven samples at 10 ms: the sixth.
    assert stops.index(True) == 6 + 5
    assert monitor.result().force_n == 50.0 and monitor.collided()


def test_forces_of_fingers_that_an_object_spreads_apart_cancel_and_weights_do_not() -> None:
    """After closing: the net force on the hand is the object's weight, however hard it grips."""
    runner, grasp = setup("parallel", box(mass_kg=0.5))
    net = []

    def record(model: object, data: mujoco.MjData, phase: str) -> None:
        if phase == "lift":
            forces = forces_on_hand(runner.scene)
            assert set(forces) == {"object"}
            net.append(forces["object"])

    runner.run(IDENTITY, grasp, record=record, early_stop=False)
    np.testing.assert_allclose(np.median(net, axis=0), [0, 0, -0.5 * 9.81], atol=0.05)


@pytest.mark.slow
def test_trials_without_limits_are_those_recorded() -> None:
    """Trials recorded with this version of the physics and of early stopping, to the last bit."""
    recorded = json.loads(RECORDED.read_text())
    assert replace(TrialSettings(), **UNLIMITED).digest() == recorded["settings"]  # type: ignore[arg-type]
    here = {"mujoco": mujoco.__version__, "machine": platform.machine()}
    here |= {"system": platform.system()}
    if any(recorded[key] != value for key, value in here.items()):
        pytest.skip(f"recorded with {recorded['mujoco']} on another kind of machine")
    for gripper in GRIPPERS:
        digests, found = [], []
        runners: dict[TrialRunner, TrialRunner] = {}
        for runner, error, grasp in sample(gripper, 48):
            if runner not in runners:
                runners[runner] = limited(runner, UNLIMITED)
                digests.append(runners[runner].digest)
            found.append(runners[runner].run(error, grasp))
        runner, grasp = setup(gripper, box(), **UNLIMITED)
        found += [runner.run(moved(z=z), grasp) for z in (-0.04, -0.02, -0.08)]
        assert digests == recorded["trials"][gripper]["digests"]
        same = [[o.reason, float(o.offset_m).hex(), o.steps] for o in found]
        assert same == recorded["trials"][gripper]["outcomes"]
        assert all(np.isnan(o.short_m) and np.isnan(o.force_n) and o.hit is None for o in found)


def test_a_collision_repeats_bit_by_bit_and_when_watched() -> None:
    runner, grasp = setup("parallel", cylinder())
    once = timeless(runner.run(moved(z=-0.05), grasp))
    assert "collided" in once
    runner.run(IDENTITY, grasp)
    assert timeless(runner.run(moved(z=-0.05), grasp, record=lambda *_: None)) == once
    assert timeless(setup("parallel", cylinder())[0].run(moved(z=-0.05), grasp)) == once
