"""Grades over jittered copies, and loads after the lift."""

from __future__ import annotations

import math

import numpy as np
import pytest
from graspcast.grasping.stress import Stress, graded, stress
from solids import IDENTITY, box, from_above

from graspcast.errors import InputError
from graspcast.pose.transforms import transform
from graspcast.simulation.grippers import FrankaHand
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.trial import TrialRunner


@pytest.fixture(scope="module")
def runner() -> TrialRunner:
    return TrialRunner(box(), FrankaHand())


GRASP = Grasp(from_above(box(), 0.02), "box", "parallel")


def test_a_grade_falls_from_one_to_zero_across_the_edge_of_what_is_held(
    runner: TrialRunner,
) -> None:
    # The box has 10 mm of play on either side between the open fingers.
    at = [transform(np.eye(3), np.array([x, 0, 0])) for x in (0.0, 0.010, 0.02)]
    scores = [graded(runner, error, GRASP, copies=8).score for error in at]
    assert scores[0] == 1.0
    assert 0.0 < scores[1] < 1.0
    assert scores[2] < scores[1]


def test_a_grade_repeats_with_its_seed_and_counts_its_outcomes(runner: TrialRunner) -> None:
    error = transform(np.eye(3), np.array([0.010, 0, 0]))
    one, same, other = (graded(runner, error, GRASP, copies=8, seed=s) for s in (1, 1, 2))
    offsets = [[o.offset_m for o in grade.outcomes] for grade in (one, same, other)]
    assert repr(offsets[0]) == repr(offsets[1]) != repr(offsets[2])
    assert one.score == np.mean([outcome.success for outcome in one.outcomes])
    with pytest.raises(InputError, match="copies is 0"):
        graded(runner, IDENTITY, GRASP, copies=0)


def test_a_firm_grip_bears_tugs_and_shaking_that_tear_a_weak_one_away(runner: TrialRunner) -> None:
    borne = stress(runner, IDENTITY, GRASP)
    assert (borne.trial.reason, borne.failed_at) == ("held", None)
    assert borne.offset_m < 0.005
    # Twice 60 N at a friction of 0.8 bear 96 N; 40 times the weight is 137 N.
    torn = stress(runner, IDENTITY, GRASP, Stress(tug_g=40.0))
    assert torn.failed_at is not None
    assert torn.failed_at.startswith("tug")
    assert torn.offset_m > runner.settings.tolerance_m
    shaken = stress(runner, IDENTITY, GRASP, Stress(tug_g=0.0, shake_g=60.0, shake_hz=1.0))
    assert shaken.failed_at is not None
    assert shaken.failed_at.startswith("shake")


def test_what_was_not_held_is_not_stressed(runner: TrialRunner) -> None:
    outcome = stress(runner, transform(np.eye(3), np.array([3.0, 0, 0])), GRASP)
    assert outcome.failed_at == "trial"
    assert math.isnan(outcome.offset_m)


def test_loads_leave_no_trace_in_the_next_trial(runner: TrialRunner) -> None:
    before = runner.run(IDENTITY, GRASP)
    stress(runner, IDENTITY, GRASP, Stress(tug_g=40.0))
    after = runner.run(IDENTITY, GRASP)
    assert (before.offset_m, before.steps) == (after.offset_m, after.steps)


def test_the_course_pulls_both_ways_along_every_axis_and_shakes_to_and_fro() -> None:
    course = dict(Stress(tug_g=2.0, shake_g=3.0).course())
    assert list(course) == [
        *[f"tug {s}{a}" for a in "xyz" for s in "+-"],
        *[f"shake {a}" for a in "xyz"],
    ]
    np.testing.assert_array_equal(course["tug -y"], np.tile([0.0, -2.0, 0.0], (25, 1)))
    assert course["shake z"][:, 2].max() == pytest.approx(3.0, abs=0.2)
    assert abs(course["shake z"].mean()) < 0.1
