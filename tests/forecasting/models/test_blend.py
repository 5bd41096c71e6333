"""The default forecaster: what each part answers for, calibration, and what cannot matter."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import synthetic
from graspcast.bop.models import Models
from graspcast.errors import InputError, TrainingDataWarning
from graspcast.evaluation.scores import score
from graspcast.forecasting.features import features_of
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.models.blend import Blend, ForestSettings
from graspcast.forecasting.simulated_trials import SimulatedTrials
from graspcast.forecasting.train import train_forecaster
from graspcast.forecasting.training_data import TrainingData
from poses import write_models

QUICK = ForestSettings(trees=8, draws=16, folds=2)


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={}, obj_3={})
    return {"d": Models(folder)}


def learned(n: int = 160, **changes: object) -> TrainingData:
    """Training data in which object 2 has no outcomes but simulated trials."""
    given = synthetic.training_data(n)
    success = np.where(given.estimates.obj_id == 1, given.success, np.nan)
    simulated = synthetic.error_outcomes(300, "d-2")
    return dataclasses.replace(given, success=success, simulated=simulated, **changes)


def trained(given: TrainingData, models: dict[str, Models], **options: object) -> Forecaster:
    forests = dataclasses.replace(QUICK, **options)
    return train_forecaster(given, forests=forests, models=models)


@pytest.fixture(scope="module")
def forecaster(models: dict[str, Models]) -> Forecaster:
    return trained(learned(), models)


def blend_of(forecaster: Forecaster) -> Blend:
    assert isinstance(forecaster.predictor, Blend)
    return forecaster.predictor


def rows_of(models: dict[str, Models], n: int = 60) -> np.ndarray:
    unseen = synthetic.training_data(n, seed=40).estimates
    return features_of(unseen, "a", "full", models).values


# --- Which part answers ---------------------------------------------------------------------------


def test_an_object_with_only_simulated_trials_is_answered_by_two_stages_alone(
    forecaster: Forecaster, models: dict[str, Models]
) -> None:
    assert forecaster.card.objects == ("d-1", "d-2")
    assert forecaster.card.simulated == ("d-2",)
    blend, rows = blend_of(forecaster), rows_of(models)
    tried, simulated = np.zeros(60, np.int64), np.ones(60, np.int64)
    mixed, staged = blend.raw(rows, simulated)
    assert_array_equal(mixed, staged)
    alone = dataclasses.replace(blend, direct=None)
    assert_array_equal(alone.probability(rows, simulated), blend.probability(rows, simulated))
    mixed, staged = blend.raw(rows, tried)
    assert (mixed != staged).any()
    direct, _ = dataclasses.replace(blend, weight=1.0).raw(rows, tried)
    assert_allclose(mixed, (direct + staged) / 2, atol=1e-12)


def test_an_object_known_by_simulation_alone_is_forecast_better_than_by_its_rate(
    forecaster: Forecaster, models: dict[str, Models]
) -> None:
    unseen = synthetic.training_data(200, seed=41)
    mine = unseen.estimates.obj_id == 2
    found = forecaster.probability(unseen.estimates.select(mine), models)
    held = unseen.success[0, mine] == 1
    scores = score(found, held, unseen.estimates.objects[mine])
    assert scores.auroc > 0.75
    assert scores.brier < held.var()


def test_an_unseen_object_is_answered_by_the_direct_forest(
    forecaster: Forecaster, models: dict[str, Models]
) -> None:
    rows, unseen = rows_of(models), np.full(60, -1)
    mixed, staged = blend_of(forecaster).raw(rows, unseen)
    assert np.isnan(staged).all()
    assert ((mixed >= 0) & (mixed <= 1)).all()


def test_without_truth_there_is_the_direct_forest_and_without_anything_an_error(
    models: dict[str, Models],
) -> None:
    without = synthetic.training_data(80)
    without = dataclasses.replace(without, truth=np.full((80, 4, 4), np.nan))
    blend = blend_of(trained(without, models, folds=0))
    assert blend.success_given_error is None
    assert blend.direct is not None
    with pytest.raises(InputError, match="no instance has a known true pose"):
        train_forecaster(without, method="two-stage", forests=QUICK, models=models)


# --- What cannot matter ---------------------------------------------------------------------------


def test_the_batch_makes_no_difference_bit_by_bit(
    forecaster: Forecaster, models: dict[str, Models]
) -> None:
    blend, rows = blend_of(forecaster), rows_of(models)
    numbers = np.arange(60) % 3 - 1
    together = blend.probability(rows, numbers)
    order = np.random.default_rng(0).permutation(60)
    assert_array_equal(blend.probability(rows[order], numbers[order]), together[order])
    single = [blend.probability(rows[i : i + 1], numbers[i : i + 1])[0] for i in range(60)]
    assert_array_equal(single, together)


@pytest.mark.slow
def test_training_again_is_the_same_bit_by_bit_and_another_seed_is_not(
    forecaster: Forecaster, models: dict[str, Models]
) -> None:
    unseen = synthetic.training_data(40, seed=9).estimates
    expected = forecaster.probability(unseen, models)
    assert_array_equal(trained(learned(), models).probability(unseen, models), expected)
    other = trained(learned(), models, seed=1).probability(unseen, models)
    assert (other != expected).any()


@pytest.mark.slow
def test_simulated_trials_of_tried_objects_and_of_other_objects_do_not_matter(
    forecaster: Forecaster, models: dict[str, Models]
) -> None:
    given = learned()
    assert given.simulated is not None
    more = synthetic.error_outcomes(200, "d-1", seed=3)
    for flip in (False, True):
        both = SimulatedTrials(
            np.concatenate([given.simulated.objects, more.objects]),
            np.concatenate([given.simulated.obj_T_est, more.obj_T_est]),
            np.concatenate([given.simulated.success, more.success ^ flip]),
        )
        again = trained(dataclasses.replace(given, simulated=both), models)
        unseen = synthetic.training_data(40, seed=9).estimates
        expected = forecaster.probability(unseen, models)
        # (outcomes of d-1 in every fold's training part outweigh its simulated trials)
        assert_array_equal(again.probability(unseen, models), expected)


def test_outcomes_of_one_scene_among_several_train_without_calibration(
    models: dict[str, Models],
) -> None:
    given = synthetic.training_data(120)
    first = given.estimates.scene_id == given.estimates.scene_id[0]
    success = np.where(first, given.success, np.nan)
    with pytest.warns(TrainingDataWarning, match="not calibrated: that takes outcomes in two"):
        forecaster = trained(dataclasses.replace(given, success=success), models)
    assert blend_of(forecaster).out_of_fold is None
    assert_array_equal(blend_of(forecaster).calibration, [[1, 0], [1, 0]])
    assert any("not calibrated" in text for text in forecaster.card.warnings)
    assert np.isfinite(forecaster.probability(given.estimates, models)).all()


def test_outcomes_of_instances_that_were_not_selected_do_not_matter(
    models: dict[str, Models],
) -> None:
    given = synthetic.training_data(120)
    kept = np.arange(120) < 80
    flipped = np.where(kept, given.success, 1 - given.success)
    assert (flipped != given.success).any()
    one = trained(given.select(kept), models, folds=0)
    two = trained(dataclasses.replace(given, success=flipped).select(kept), models, folds=0)
    assert one.card.digest == two.card.digest
    unseen = given.estimates.select(~kept)
    assert_array_equal(one.probability(unseen, models), two.probability(unseen, models))


# --- Calibration ----------------------------------------------------------------------------------


def logit(p: np.ndarray) -> np.ndarray:
    return np.asarray(np.log(p / (1 - p)))


def test_the_calibration_of_each_part_is_applied_to_its_objects(
    forecaster: Forecaster, models: dict[str, Models]
) -> None:
    rows, blend = rows_of(models), blend_of(forecaster)
    table = np.array([[2.0, 0.3], [0.5, -0.2]])
    changed = dataclasses.replace(blend, calibration=table)
    for number, (slope, shift) in enumerate(table):
        numbers = np.full(60, number)
        raw = np.clip(blend.raw(rows, numbers)[0], 1e-3, 1 - 1e-3)
        expected = 1 / (1 + np.exp(-(slope * logit(raw) + shift)))
        assert_allclose(changed.probability(rows, numbers), expected, atol=1e-12)


# --- Files ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "method", ["blend", pytest.param("two-stage", marks=pytest.mark.slow), "direct"]
)
def test_it_comes_back_from_its_file_bit_by_bit(
    method: str, models: dict[str, Models], tmp_path: Path
) -> None:
    made = train_forecaster(learned(100), method=method, forests=QUICK, models=models)
    made.save(tmp_path / "model.npz")
    again = Forecaster.load(tmp_path / "model.npz")
    unseen = synthetic.training_data(40, seed=9).estimates
    mine = unseen.select(np.isin(unseen.objects, made.card.objects))
    assert_array_equal(again.probability(mine, models), made.probability(mine, models))
    assert_array_equal(again.p_value(mine), made.p_value(mine))
    assert again.explain(mine, models) == made.explain(mine, models)
    assert (again.card, again.card.digest) == (made.card, made.card.digest)
    assert [made.predictor.direct is None, made.predictor.success_given_error is None] == [  # type: ignore[union-attr]
        method == "two-stage",
        method == "direct",
    ]
