from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from jaxtyping import Float
from numpy import ndarray

from bricks import brick, from_top
from graspcast.errors import InputError
from graspcast.pose.transforms import exp
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.grasps.evaluation import (
    evaluate_grasp,
    held_under_jitter,
    simulate_success,
)
from graspcast.simulation.grasps.observed_trials import ObservedTrials
from graspcast.simulation.grasps.sampling import LabelledTrials
from graspcast.simulation.grasps.search import SearchEffort, fit_grasp
from graspcast.simulation.grippers import load_gripper
from graspcast.simulation.objects.types import Grasp
from graspcast.simulation.trial.trial import TrialRunner

SMALL = SearchEffort(
    proposals=40,
    candidates=5,
    variations=2,
    first_trials=6,
    last_trials=18,
    validation_trials=18,
)
TINY = SearchEffort(
    proposals=20,
    candidates=2,
    variations=1,
    first_trials=4,
    last_trials=6,
    validation_trials=6,
)


def errors(count: int, seed: int) -> Float[ndarray, "n 4 4"]:
    rng = np.random.default_rng(seed)
    return exp(rng.standard_normal((count, 6)) * np.repeat([0.015, 0.15], 3))


def truth(count: int, seed: int) -> LabelledTrials:
    """What our own simulator says of a grasp that the search does not know."""
    runner = TrialRunner(brick(), load_gripper("parallel"))
    grasp = Grasp(from_top(0.025), "box", "parallel")
    poses = errors(count, seed)
    empty = LabelledTrials(poses, np.zeros(count, dtype=bool))
    return LabelledTrials(poses, simulate_success(runner, grasp, empty))


@pytest.mark.slow
def test_the_search_finds_a_grasp_that_behaves_like_the_unknown_one() -> None:
    test = truth(80, seed=3)
    found = fit_grasp(
        brick(), load_gripper("parallel"), truth(60, seed=1), truth(40, seed=2), effort=SMALL
    )
    scored = evaluate_grasp(found.reference, brick(), load_gripper("parallel"), test)
    assert 0.2 < scored.given_rate < 0.8
    assert scored.accuracy > scored.majority + 0.1 and scored.kappa > 0.5
    assert found.held == 20
    runner = TrialRunner(brick(), load_gripper("parallel"))
    grasp = found.reference.grasp
    assert held_under_jitter(runner, grasp) == held_under_jitter(runner, grasp)
    figures = found.with_test(scored, seed=0).agreement
    assert figures["test_accuracy"] == round(scored.accuracy, 4)
    assert figures["candidates"] == found.candidates > 6


@pytest.mark.slow
def test_the_same_seed_finds_the_same_grasp_whatever_the_test_split_says() -> None:
    """The search does not see the test split, so changing its outcomes changes nothing."""
    labelled = truth(60, seed=1)
    split = np.repeat(["train", "validation", "test"], 20)
    keys = pl.DataFrame({"im_id": np.arange(60)}).with_columns(
        estimator=pl.lit("e"),
        dataset=pl.lit("d"),
        scene_id=pl.lit(0),
        obj_id=pl.lit(0),
        est_id=pl.lit(0),
        gripper=pl.lit("parallel"),
        object=pl.lit("box"),
    )
    poisoned = labelled.success ^ (split == "test")
    poses = []
    for success in (labelled.success, poisoned):
        trials = ObservedTrials(TrialRequests(keys, labelled.obj_T_est), success, split)
        found = fit_grasp(
            brick(),
            load_gripper("parallel"),
            trials.of("box", "parallel", "train"),
            trials.of("box", "parallel", "validation"),
            effort=TINY,
            seed=5,
        )
        poses.append(
            (found.reference.grasp.obj_T_grasp, found.train, found.validation, found.trials)
        )
    assert np.array_equal(poses[0][0], poses[1][0]) and poses[0][1:] == poses[1][1:]


def test_a_split_without_trials() -> None:
    none = LabelledTrials(np.zeros((0, 4, 4)), np.zeros(0, dtype=bool))
    one = LabelledTrials(np.eye(4)[None], np.ones(1, dtype=bool))
    with pytest.raises(InputError, match="no outcomes in the validation split"):
        fit_grasp(brick(), load_gripper("parallel"), one, none)
