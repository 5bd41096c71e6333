from __future__ import annotations

import numpy as np
import pytest

from bricks import brick, from_top
from graspcast.pose.transforms import exp
from graspcast.simulation.grasps.diversity import Spacing
from graspcast.simulation.grasps.ranking import (
    Effort,
    RankedGrasp,
    Ranking,
    rank_grasps,
    success_interval,
)
from graspcast.simulation.grasps.trial_pool import TrialPool
from graspcast.simulation.grippers import load_gripper

EFFORT = Effort(candidates=4, first_errors=3, parents=1, variations=1, jitter=2, final=2)


def _moved(y: float, depth: float) -> np.ndarray:
    pose = from_top(depth)
    pose[1, 3] = y
    return pose


def _ranked(fixed: int = 0) -> Ranking:
    rng = np.random.default_rng(0)
    errors = exp(rng.standard_normal((40, 6)) * np.repeat([0.006, 0.08], 3))
    depths = (0.02, 0.008, -0.03)
    grasps = [RankedGrasp(_moved(0.0, depth), f"{depth}") for depth in depths]
    pool = TrialPool(brick(), load_gripper("parallel"), workers=1)
    spacing = Spacing(0.005, 0.3, np.eye(4)[None], np.eye(4)[None])
    grasps = grasps[::-1]
    random = np.random.default_rng(1)
    return rank_grasps(pool, grasps, errors, spacing, random, count=3, effort=EFFORT, fixed=fixed)


@pytest.mark.slow
def test_grasps_are_ordered_by_the_lower_end_of_their_intervals() -> None:
    found = _ranked()
    lows = [grasp.interval[0] for grasp in found.grasps]
    assert len(lows) >= 2 and lows == sorted(lows, reverse=True)
    assert "-0.03" not in {grasp.origin for grasp in found.grasps}, "it grasps air"
    assert found.reasons["held"] == 2 and found.reasons["missed"] == 1
    best = found.grasps[0]
    assert (best.held, best.of) == (2, 2) and len(best.success) == 24
    again = _ranked()
    assert [g.success for g in again.grasps] == [g.success for g in found.grasps]


@pytest.mark.slow
def test_a_fixed_grasp_is_ranked_even_if_it_never_holds() -> None:
    found = _ranked(fixed=1)
    (air,) = [grasp for grasp in found.grasps if grasp.origin == "-0.03"]
    assert air is found.grasps[-1] and air.rate == 0.0 and len(air.success) == 24
    assert np.isnan(air.survived_deviations(np.tile(np.eye(4), (40, 1, 1)))).all()


def test_survived_errors_are_those_of_the_hand_in_the_grasp_s_frame() -> None:
    errors = np.tile(np.eye(4), (3, 1, 1))
    errors[0, 2, 3], errors[1, 2, 3], errors[2, 0, 3] = 0.01, -0.01, 0.5
    grasp = RankedGrasp(from_top(0.02), "", [True, True, False])
    assert np.allclose(grasp.survived_deviations(errors), [0, 0, 0.01, 0, 0, 0])


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(0, 0, 0, 1), (0, 10, 0, 0.1702), (10, 10, 0.8298, 1), (5, 10, 0.2634, 0.7366)],
)
def test_intervals(successes: int, trials: int, low: float, high: float) -> None:
    assert success_interval(successes, trials) == pytest.approx((low, high), abs=3e-2)


def test_effort_grows_with_its_factor() -> None:
    larger = Effort().scaled(4.0)
    assert (larger.candidates, larger.first_errors) == (240, 12)
    assert Effort().scaled(1.0) == Effort()
