from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cubes import MISS, OFF
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.recording import Recording, record_trial
from graspcast.simulation.trial.trial import TrialRunner
from solids import IDENTITY, box, from_above


@pytest.fixture(scope="module")
def runner() -> TrialRunner:
    return TrialRunner(box(), load_gripper("parallel"))


@pytest.fixture(scope="module")
def grasp() -> Grasp:
    return Grasp(from_above(box(), 0.015), "box", "parallel")


@pytest.fixture(scope="module")
def held(runner: TrialRunner, grasp: Grasp) -> Recording:
    return record_trial(runner, OFF, grasp)


@pytest.mark.parametrize("obj_T_est", [IDENTITY, OFF, MISS], ids=["perfect", "off", "far"])
@pytest.mark.parametrize("early_stop", [True, False])
def test_recording_does_not_change_the_outcome(
    runner: TrialRunner, grasp: Grasp, obj_T_est: np.ndarray, early_stop: bool
) -> None:
    plain = runner.run(obj_T_est, grasp, early_stop=early_stop)
    seen = record_trial(runner, obj_T_est, grasp, early_stop=early_stop).outcome
    assert repr(replace(plain, computed_s=0.0)) == repr(replace(seen, computed_s=0.0))


def test_a_recording_runs_forward_in_time_and_in_space(held: Recording) -> None:
    times = np.array([state.time_s for state in held.states])
    assert (np.diff(times) > 0).all() and np.diff(times).max() < 0.05
    approach = held.of("approach")
    heights = np.array([state.sim_T_base[2, 3] for state in approach])
    assert (np.diff(heights) < 1e-6).all()
    assert heights[0] - heights[-1] == pytest.approx(0.1, abs=1e-3)
    speeds = np.diff(heights) / np.diff(times[: len(approach)])
    assert speeds[:-10] == pytest.approx(-0.1, abs=0.02)
    film = held.every(0.1)
    assert film[0] is held.states[0] and film[-1] is held.states[-1]
    assert len(film) == pytest.approx(times[-1] / 0.1 + 1, abs=1)


def test_the_estimate_is_drawn_where_it_differs_and_until_the_lift(
    runner: TrialRunner, grasp: Grasp, held: Recording
) -> None:
    assert held.overlay(held.of("close")[-1]) is held.sim_T_est
    assert held.overlay(held.of("lift")[-1]) is None
    perfect = record_trial(runner, IDENTITY, grasp)
    assert perfect.overlay(perfect.states[0]) is None
