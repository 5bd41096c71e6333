"""One trial: the change of frame, every reason, and repeatability."""

from __future__ import annotations

import math
import random
import threading
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from graspcast.errors import InputError, MismatchError
from graspcast.pose.transforms import exp, invert, transform
from graspcast.simulation.grippers import FrankaHand, TendonHand, load_gripper
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial import trial as trial_module
from graspcast.simulation.trial.scene import HAND, Scene
from graspcast.simulation.trial.trial import TrialRunner, TrialSettings
from solids import IDENTITY, box, cylinder, errors
from trials import GRIPPERS, HANDS, moved, nail, sample, setup, timeless


@pytest.mark.parametrize("gripper", HANDS)
@pytest.mark.parametrize(
    "target", [cylinder(), box(), box(mesh=True)], ids=["cylinder", "box", "mesh"]
)
def test_a_perfect_estimate_is_held(gripper: str, target: GraspObject) -> None:
    runner, grasp = setup(gripper, target)
    outcome = runner.run(IDENTITY, grasp)
    assert (outcome.success, outcome.reason) == (True, "held")
    assert outcome.offset_m < 0.02
    assert outcome.simulated_s == pytest.approx(outcome.steps * runner.settings.timestep)


@pytest.mark.parametrize("gripper", HANDS)
def test_the_tool_centre_point_goes_to_the_grasp_carried_over_to_the_estimate(gripper: str) -> None:
    target = cylinder(lying=True)
    runner, grasp = setup(gripper, target, 0.3)
    (obj_T_est,) = errors(np.random.default_rng(3), 1, 0.02, 0.2)
    sim_T_tcp = target.sim_T_ref @ obj_T_est @ grasp.obj_T_grasp
    places = []

    def record(model: object, data: mujoco.MjData, phase: str) -> None:
        base = data.body(runner.scene.base_body)
        sim_T_base = transform(base.xmat.reshape(3, 3).copy(), base.xpos.copy())
        places.append((phase, sim_T_base @ runner.gripper.base_T_tcp))

    runner.run(obj_T_est, grasp, record=record, early_stop=False)
    before = sim_T_tcp @ moved(z=-runner.settings.standoff_m)
    np.testing.assert_allclose(places[0][1], before, atol=1e-9)
    grasped = next(place for phase, place in places if phase == "close")
    # The hand weighs on its stiff arm: some tens of micrometres.
    np.testing.assert_allclose(grasped, sim_T_tcp, atol=2e-4)
    lifted = places[-1][1] - grasped
    np.testing.assert_allclose(lifted[:3, :3], 0.0, atol=1e-9)
    np.testing.assert_allclose(lifted[:3, 3], [0, 0, runner.settings.lift_height_m], atol=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize("gripper", HANDS)
def test_where_an_object_s_frame_is_makes_no_difference(gripper: str) -> None:
    plain = box(0.05, 0.07, 0.06)
    new_T_old = exp(np.array([0.15, -0.1, 0.05, 0.4, 0.9, -0.3]))
    turn = new_T_old[:3, :3]
    shifted = replace(
        plain,
        pieces=tuple(replace(p, obj_T_geom=new_T_old @ p.obj_T_geom) for p in plain.pieces),
        centroid=new_T_old[:3, 3],
        inertia=turn @ plain.inertia @ turn.T,
        sim_T_ref=plain.sim_T_ref @ invert(new_T_old),
    )
    runner, grasp = setup(gripper, plain)
    other = TrialRunner(shifted, load_gripper(gripper))
    moved_grasp = replace(grasp, obj_T_grasp=new_T_old @ grasp.obj_T_grasp)
    reasons = []
    for error in [*errors(np.random.default_rng(4), 8, 0.015, 0.15), moved(x=0.06, z=0.03)]:
        one = runner.run(error, grasp)
        same = other.run(new_T_old @ error @ invert(new_T_old), moved_grasp)
        assert one.reason == same.reason
        if one.success:
            assert one.offset_m == pytest.approx(same.offset_m, abs=5e-3)
        reasons.append(one.reason)
    assert len(set(reasons)) > 1


@pytest.mark.parametrize("gripper", HANDS)
def test_a_hand_that_starts_in_the_object_or_the_table_is_blocked(gripper: str) -> None:
    runner, grasp = setup(gripper, box(z=0.3), 0.0)
    for error in (moved(z=-0.1), moved(z=-0.6), moved(x=0.5, z=-0.6)):
        outcome = runner.run(error, grasp)
        assert (outcome.reason, outcome.success, outcome.steps) == ("blocked", False, 0)
        assert math.isnan(outcome.offset_m)


@pytest.mark.parametrize("gripper", HANDS)
def test_a_hand_that_would_end_its_approach_in_the_object_is_blocked_beyond_the_limit(
    gripper: str,
) -> None:
    free, grasp = setup(gripper, cylinder())
    limited, _ = setup(gripper, cylinder(), goal_overlap_m=0.003)
    looser, _ = setup(gripper, cylinder(), goal_overlap_m=0.006)

    def first_blocked_mm(runner: TrialRunner) -> int:
        errors = ((depth, moved(z=-1e-3 * depth)) for depth in range(80))
        return next(mm for mm, e in errors if runner.run(e, grasp).reason == "blocked")

    first = first_blocked_mm(limited)
    assert first_blocked_mm(looser) - first in (3, 4)
    outcome = limited.run(moved(z=-1e-3 * first), grasp)
    assert (outcome.success, outcome.steps) == (False, 0)
    for error in (moved(), moved(z=-1e-3 * (first - 1))):
        assert timeless(limited.run(error, grasp)) == timeless(free.run(error, grasp))
    # The table does not count: it is as hard for a hand that is far from the object.
    assert limited.run(moved(x=0.5, z=-0.1), grasp).reason != "blocked"


def test_where_the_table_does_not_stop_the_hand_it_does_not_block_it() -> None:
    runner, grasp = setup("parallel", box(), hand_touches_table=False)
    outcome = runner.run(moved(x=0.5, z=-0.6), grasp)
    assert outcome.reason == "missed"


@pytest.mark.parametrize("gripper", HANDS)
def test_closing_beside_the_object_is_missed(gripper: str) -> None:
    runner, grasp = setup(gripper, box(0.03, 0.03, 0.06))
    outcomes = [runner.run(moved(y=-0.12), grasp, early_stop=stop) for stop in (True, False)]
    assert [outcome.reason for outcome in outcomes] == ["missed", "missed"]
    assert outcomes[0].offset_m == pytest.approx(outcomes[1].offset_m, abs=3e-3)


@pytest.mark.parametrize("gripper", HANDS)
def test_what_is_too_slippery_is_dropped(gripper: str) -> None:
    runner, grasp = setup(gripper, box(friction=0.01))
    outcome = runner.run(IDENTITY, grasp)
    assert outcome.reason == "dropped"
    assert outcome.offset_m > runner.settings.tolerance_m


def test_what_slides_too_far_and_is_caught_has_slipped() -> None:
    gripper = FrankaHand()
    runner = TrialRunner(nail(), gripper)
    # From the side, near the foot; the fingers close along y.
    obj_T_grasp = transform(np.array([[0, 0, 1.0], [1, 0, 0], [0, 1, 0]]), np.array([0, 0, -0.02]))
    for stop in (True, False):
        outcome = runner.run(IDENTITY, Grasp(obj_T_grasp, "nail", "parallel"), early_stop=stop)
        assert outcome.reason == "slipped"
        # Pads of 8.5 mm half height, from 2 cm under the middle to the head at 6 cm.
        assert outcome.offset_m == pytest.approx(0.02 + 0.06 - 0.0085, abs=2e-3)


@pytest.mark.slow
def test_a_simulation_that_blows_up_is_unstable_and_the_next_trial_is_as_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    runner, grasp = setup("parallel", box())
    sound = runner.run(IDENTITY, grasp)
    for value in (math.nan, math.inf, 1e9):

        def sabotage(model: object, data: mujoco.MjData, phase: str, v: float = value) -> None:
            if phase == "close":
                data.qvel[0] = v

        outcome = runner.run(IDENTITY, grasp, record=sabotage)
        assert (outcome.success, outcome.reason) == (False, "unstable")
        assert math.isnan(outcome.offset_m)
        assert timeless(runner.run(IDENTITY, grasp)) == timeless(sound)
    assert list(tmp_path.iterdir()) == [], "nothing is logged into the working directory"


@pytest.mark.slow
@pytest.mark.parametrize("gripper", HANDS)
def test_the_free_part_of_the_approach_has_no_consequence(
    gripper: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    trials = list(sample(gripper, 60))
    skipped = [runner.run(error, grasp) for runner, error, grasp in trials]
    from_afar = lambda self: -self.settings.standoff_m  # noqa: E731
    monkeypatch.setattr(trial_module._Trial, "_clear_until", from_afar)
    whole = [runner.run(error, grasp) for runner, error, grasp in trials]
    assert sum(o.steps for o in whole) > sum(o.steps for o in skipped)
    differing = [k for k in range(60) if whole[k].success != skipped[k].success]
    assert len(differing) <= 1, "beyond chaos at the boundary, nothing changes"


@pytest.mark.slow
@pytest.mark.parametrize("gripper", HANDS)
def test_nothing_tunnels(gripper: str) -> None:
    deepest = [0.0]
    for runner, error, grasp in sample(gripper, 48):

        def record(_: object, data: mujoco.MjData, phase: str, s: Scene = runner.scene) -> None:
            by_hand = (s.kind[data.contact.geom] == HAND).any(axis=1)
            deepest.append(-float(data.contact.dist[by_hand].min(initial=0.0)))

        runner.run(error, grasp, record=record)
    # Half of what is thin in either hand: a pad is 9.5 mm deep, a capsule 24 mm.
    assert 0.0 < max(deepest) < {"parallel": 4.75e-3, "underactuated": 12e-3}[gripper]


@pytest.mark.parametrize("gripper", HANDS)
def test_a_trial_repeats_bit_by_bit_in_any_order_in_any_runner_and_when_watched(
    gripper: str,
) -> None:
    target = cylinder()
    runner, grasp = setup(gripper, target)
    trials = [*errors(np.random.default_rng(1), 12, 0.015, 0.15), moved(z=-0.3), moved(x=2.0)]
    once = [timeless(runner.run(error, grasp)) for error in trials]
    order = list(range(len(trials)))
    random.Random(5).shuffle(order)
    for k in order:
        assert timeless(runner.run(trials[k], grasp)) == once[k]
    fresh, _ = setup(gripper, target)
    for k in order[:5]:
        assert timeless(fresh.run(trials[k], grasp, record=lambda *_: None)) == once[k]
    assert len(set(once)) > 5


@pytest.mark.slow
def test_runners_in_two_threads_do_not_disturb_each_other() -> None:
    trials = errors(np.random.default_rng(2), 6, 0.015, 0.15)
    runners = [setup(name, cylinder()) for name in GRIPPERS]
    alone = [[timeless(r.run(e, g)) for e in trials] for r, g in runners]
    together: dict[int, list[str]] = {}

    def work(k: int) -> None:
        runner, grasp = runners[k]
        together[k] = [timeless(runner.run(error, grasp)) for error in trials]

    threads = [threading.Thread(target=work, args=(k,)) for k in range(len(runners))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [together[k] for k in range(len(runners))] == alone


def test_a_watcher_sees_the_phases_in_order_at_even_times() -> None:
    runner, grasp = setup("parallel", box())
    seen: list[tuple[str, float]] = []
    runner.run(IDENTITY, grasp, record=lambda model, data, phase: seen.append((phase, data.time)))
    phases = [phase for phase, _ in seen]
    assert list(dict.fromkeys(phases)) == ["approach", "close", "lift"]
    times = np.array([time for _, time in seen])
    assert np.all(np.diff(times) >= 0)
    assert np.diff(times).max() <= 0.02 + 1e-9


def test_wrong_input_is_named() -> None:
    runner, grasp = setup("parallel", box())
    with pytest.raises(InputError, match="estimate of 'box' must be a finite"):
        runner.run(np.full((4, 4), math.nan), grasp)
    with pytest.raises(InputError, match="must be a rigid transform"):
        runner.run(np.diag([1.0, 1.0, 2.0, 1.0]), grasp)
    with pytest.raises(MismatchError, match="for the object 'mug', the trial for 'box'"):
        runner.run(IDENTITY, replace(grasp, object="mug"))
    with pytest.raises(MismatchError, match="for the gripper 'claw', the trial for 'parallel'"):
        runner.run(IDENTITY, replace(grasp, gripper="claw"))


def test_a_runner_s_digest_follows_object_gripper_and_settings() -> None:
    digests = [
        TrialRunner(box(), FrankaHand()).digest,
        TrialRunner(box(mass_kg=0.4), FrankaHand()).digest,
        TrialRunner(box(friction=0.7), FrankaHand()).digest,
        TrialRunner(box(mesh=True), FrankaHand()).digest,
        TrialRunner(box(), FrankaHand(grip_n=50.0)).digest,
        TrialRunner(box(), TendonHand()).digest,
        TrialRunner(box(), FrankaHand(), TrialSettings(impratio=5.0)).digest,
    ]
    assert len(set(digests)) == len(digests)
    assert TrialRunner(box(), FrankaHand()).digest == digests[0]
