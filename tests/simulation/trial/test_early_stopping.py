"""Early stopping: the label is that of the full lift."""

from __future__ import annotations

import pytest

from graspcast.simulation.trial.trial import REASONS
from solids import IDENTITY, box
from trials import GRIPPERS, moved, sample, setup


@pytest.mark.parametrize("gripper", GRIPPERS)
def test_an_estimate_out_of_reach_is_missed_without_simulating_and_rightly_so(gripper: str) -> None:
    runner, grasp = setup(gripper, box())
    for error in (moved(x=3.0), moved(z=0.5)):
        quick, full = (runner.run(error, grasp, early_stop=stop) for stop in (True, False))
        assert (quick.reason, quick.steps, full.reason) == ("missed", 0, "missed")
        assert quick.offset_m == pytest.approx(full.offset_m, abs=3e-3)
        assert full.steps > runner.settings.lift_s / runner.settings.timestep


@pytest.mark.slow
@pytest.mark.parametrize("gripper", GRIPPERS)
def test_stopping_early_gives_the_label_of_the_full_lift(gripper: str) -> None:
    seen: dict[str, int] = dict.fromkeys(REASONS, 0)
    saved = 0
    for runner, error, grasp in sample(gripper, 120):
        full = runner.run(error, grasp, early_stop=False)
        quick = runner.run(error, grasp)
        assert (quick.success, quick.reason) == (full.success, full.reason), error
        if full.success:
            assert quick.offset_m == pytest.approx(full.offset_m, abs=5e-3)
        seen[full.reason] += 1
        saved += full.steps - quick.steps
    assert min(seen["held"], seen["dropped"], seen["missed"], seen["collided"]) >= 5, seen
    assert saved > 0


@pytest.mark.slow
@pytest.mark.parametrize("gripper", GRIPPERS)
def test_a_slow_slip_is_followed_to_its_end(gripper: str) -> None:
    # Where friction's impedance is low it creeps, so that some grips give way only after seconds.
    seen = []
    for mass in (0.35, 1.0, 2.0):
        for impratio in (0.3, 0.6, 1.0, 2.0):
            runner, grasp = setup(gripper, box(mass_kg=mass), impratio=impratio)
            full = runner.run(IDENTITY, grasp, early_stop=False)
            quick = runner.run(IDENTITY, grasp)
            assert quick.reason == full.reason
            seen.append((quick.reason, quick.simulated_s > 4.0))
    assert {("held", True), ("dropped", True)} <= set(seen)
