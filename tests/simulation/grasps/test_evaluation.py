"""Evaluation of a reference grasp by simulation."""

from __future__ import annotations

import numpy as np
import pytest

from bricks import brick, from_top
from graspcast.pose.transforms import transform
from graspcast.simulation.grasps.evaluation import (
    evaluate_grasp,
    held_under_jitter,
    simulate_success,
)
from graspcast.simulation.grasps.sampling import LabelledTrials
from graspcast.simulation.grasps.table import ReferenceGrasp
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.trial import TrialRunner

GRASP = Grasp(from_top(0.025), "box", "parallel")
MISS = transform(np.eye(3), np.array([0.3, 0.0, 0.0]))


@pytest.fixture(scope="module")
def runner() -> TrialRunner:
    return TrialRunner(brick(), load_gripper("parallel"))


def test_a_good_grasp_is_held_under_jitter_and_a_miss_is_not(runner: TrialRunner) -> None:
    assert held_under_jitter(runner, GRASP, count=4) == 4
    beside = Grasp(MISS @ GRASP.obj_T_grasp, "box", "parallel")
    assert held_under_jitter(runner, beside, count=2) == 0


def test_agreement_counts_simulated_against_observed(runner: TrialRunner) -> None:
    poses = np.stack([np.eye(4), MISS, np.eye(4), MISS])
    trials = LabelledTrials(poses, np.array([True, False, False, False]))
    assert simulate_success(runner, GRASP, trials).tolist() == [True, False, True, False]
    reference = ReferenceGrasp(GRASP, "a test")
    found = evaluate_grasp(reference, brick(), load_gripper("parallel"), trials)
    assert (found.given_rate, found.accuracy, found.majority) == (0.25, 0.75, 0.75)
