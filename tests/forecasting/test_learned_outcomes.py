"""Outcomes of estimators that are learned from, but not needed at run time."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import graspcast
from graspcast import Episode, Forecaster
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.evaluation.cross_validation import cross_validate, cross_validated_with_views
from graspcast.evaluation.methods import training_data_of
from graspcast.evaluation.view_fusion import fuse_benchmark
from graspcast.evaluation.view_protocols import forecast_views, train_fold, view_folds
from graspcast.evaluation.view_sets import ViewModelRule, ViewRow
from graspcast.forecasting.models.blend import Blend, ForestSettings
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_data import view_data
from looked_at import CAMERAS, Training, fused, training
from viewed import SMALL, benchmark

QUICK = ForestSettings(trees=6, folds=2, draws=16)


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Training:
    """Three estimators, and poses fused from a's alone."""
    found = training(tmp_path_factory.mktemp("learned"))
    mine = {"a": found.results["a"]}
    parts = [fused(mine, found.models, found.motion, most) for most in (1, 3)]
    views = view_data(found.data.estimates.only("a"), parts, {})
    return found._replace(data=replace(found.data, views=views))


@pytest.fixture(scope="module")
def forecaster(given: Training) -> Forecaster:
    return _fitted(given, given.data, learn_from=("c", "b"))


def _fitted(given: Training, data: TrainingData, **options: object) -> Forecaster:
    return fit_forecaster(data, models=given.models, forests=QUICK, **options)  # type: ignore[arg-type]


@pytest.mark.slow
def test_it_forecasts_what_the_evaluation_does_by_outcomes_of_all(tmp_path: Path) -> None:
    found, sources = benchmark(tmp_path)
    rule = ViewModelRule(alone="a", pooled=True)
    row = ViewRow("alone, outcomes of all", 3, rule)
    whole = replace(found, views=fuse_benchmark(sources, found.estimates, [row]))
    fold = next(view_folds(whole, "several_views", "p"))
    task = fold.first
    assert task.views is not None
    pooled = train_fold(fold, [rule], SMALL).by_rule[rule]
    data = replace(training_data_of(task), principal="a", views=task.views.train[rule])
    how = {"method": "two-stage", "forests": SMALL, "models": task.models}
    learned = fit_forecaster(data, learn_from=("b", "c"), **how)  # type: ignore[arg-type]
    own = fit_forecaster(replace(data.only("a"), views=data.views), **how)  # type: ignore[arg-type]
    asked = task.views.test[row.fusion], task.test, "a", task.models
    expected = forecast_views(pooled, *asked)
    assert np.isfinite(expected).any()
    assert_allclose(forecast_views(learned, *asked), expected, atol=1e-9)
    assert not np.allclose(forecast_views(own, *asked), expected, equal_nan=True)


def test_it_needs_the_principal_alone_and_says_from_whom_it_learned(
    given: Training, forecaster: Forecaster, tmp_path: Path
) -> None:
    count = len(given.data)
    forecaster.save(tmp_path / "m.npz")
    for each in (forecaster, Forecaster.load(tmp_path / "m.npz")):
        assert (each.card.estimators, each.guides) == (("a",), ("a",))
        assert each.card.learned_from == {"b": count, "c": count}
        assert each.card.samples == count
        mine = {"a": given.results["a"]}
        several = each.judge(fused(mine, given.models, given.motion), given.models)
        assert all("3 views" in row.verdict.reason for row in several)
        table = given.results["a"]
        poses = table.cam_T_obj[(table.scene_id == 1) & (table.obj_id == 2)]
        episode = Episode(each, "d-2", models=given.models, threshold=0.999, max_looks=2)
        episode.look({"a": poses[0]}, CAMERAS[0])
        assert "2 views" in episode.look({"a": poses[1]}, CAMERAS[1]).reason
    loaded = Forecaster.load(tmp_path / "m.npz")
    assert loaded.card == forecaster.card and loaded.card.digest == forecaster.card.digest


@pytest.mark.slow
def test_one_view_is_forecast_by_own_outcomes_alone(
    given: Training, forecaster: Forecaster
) -> None:
    own = _fitted(given, replace(given.data.only("a"), views=given.data.views))
    estimates = given.data.estimates.only("a")
    assert_array_equal(forecaster.probability(estimates), own.probability(estimates))
    assert own.card.learned_from == {} and "learned_from" not in own.card.as_dict()
    assert forecaster.view_model is not None and own.view_model is not None
    kept, less = forecaster.view_model.out_of_fold, own.view_model.out_of_fold
    assert kept is not None and less is not None
    assert_array_equal(kept.success, less.success)  # of the principal's grasps alone


@pytest.mark.slow
def test_a_consensus_of_two_learns_from_the_third(given: Training) -> None:
    data = replace(given.data, views=None)
    learned = _fitted(given, data, learn_from=("c",), method="two-stage")
    own = _fitted(given, data.only("a", "b"), method="two-stage")
    assert learned.card.supporters == ("b",) and learned.guides == ("a", "b")
    estimates = given.data.estimates.only("b", "a")
    assert_array_equal(learned.p_value(estimates), own.p_value(estimates))
    assert_array_equal(learned.typical, own.typical)
    ours, theirs = learned.predictor, own.predictor
    assert isinstance(ours, Blend) and isinstance(theirs, Blend)
    assert ours.errors is not None and theirs.errors is not None
    assert_array_equal(ours.errors.truth, theirs.errors.truth)
    first = learned.probability(estimates, given.models)
    assert (first != own.probability(estimates, given.models)).any()
    blend = _fitted(given, data, learn_from=("c",))
    assert isinstance(blend.predictor, Blend)
    direct = _fitted(given, data.only("a", "b")).predictor
    assert isinstance(direct, Blend) and direct.direct is not None
    assert blend.predictor.direct is not None
    assert_array_equal(blend.predictor.direct.value, direct.direct.value)


@pytest.mark.slow
def test_an_object_that_others_grasped_alone_is_learned(given: Training) -> None:
    success = given.data.success.copy()
    success[:2, given.data.objects == "d-2"] = np.nan
    data = replace(given.data, success=success, views=None)
    learned = _fitted(given, data, learn_from=("c",))
    assert learned.card.objects == ("d-1", "d-2")
    assert _fitted(given, data.only("a", "b")).card.objects == ("d-1",)
    assert np.isfinite(learned.probability(given.data.estimates, given.models)).all()


@pytest.mark.slow
def test_instances_without_its_estimate_stay(given: Training) -> None:
    data = replace(given.data, views=None).learning_from("c")
    assert data.learned is not None
    poses, success = data.learned.cam_T_obj.copy(), data.learned.success.copy()
    poses[:, ::2] = np.nan
    data = replace(data, learned=replace(data.learned, cam_T_obj=poses))
    forecaster = _fitted(given, data)
    assert forecaster.card.samples == len(data)
    assert forecaster.card.learned_from == {"c": len(data) // 2}
    success[:, ::2] = np.nan
    same = _fitted(given, replace(data, learned=replace(data.learned, success=success)))  # type: ignore[type-var]
    estimates = given.data.estimates
    assert_array_equal(
        same.probability(estimates, given.models), forecaster.probability(estimates, given.models)
    )


def test_scores_are_of_models_that_learned_nothing_of_the_tested_scenes(given: Training) -> None:
    how = {"models": given.models, "folds": 2, "forests": ForestSettings(trees=4, folds=0)}
    data = given.data.learning_from("b", "c")
    single, several = cross_validated_with_views(data, **how)  # type: ignore[arg-type]
    assert np.isfinite(single).all() and np.isfinite(several).all()
    assert data.learned is not None
    first = data.estimates.scene_id == 1
    success = np.where(first, 1 - data.learned.success, data.learned.success)
    flipped = replace(data, learned=replace(data.learned, success=success))
    _, other = cross_validated_with_views(flipped, **how)  # type: ignore[arg-type]
    assert_array_equal(other[first], several[first])
    assert (other != several).any()
    assert data.select(np.arange(3)).learned.success.shape == (2, 3)  # type: ignore[union-attr]
    with pytest.raises(InputError, match="one estimator alone learns nothing of objects"):
        cross_validate(given.data, by="object", learn_from=("b", "c"), models=given.models)


def test_what_cannot_be_learned_from_is_told(given: Training) -> None:
    def train(data: TrainingData, *names: str, **options: object) -> None:
        graspcast.train_forecaster(data, models=given.models, learn_from=names, **options)  # type: ignore[arg-type]

    data = given.data
    with pytest.raises(InputError, match="a is the principal, from whose outcomes"):
        train(data, "b", "a")
    with pytest.raises(UnknownNameError, match="unknown estimator 'd'; known: a, b, c"):
        train(data, "d")
    with pytest.raises(MismatchError, match="fused from a, but a, b alone will be there"):
        train(data, "c")
    single = replace(data, views=None)
    with pytest.raises(InputError, match="one view of a alone is forecast by what was seen"):
        train(single, "b", "c")
    for method in ("direct", "threshold", "MLP"):
        with pytest.raises(InputError, match=f"the method {method} learns nothing from outcomes"):
            train(single, "c", method=method)
    success = data.success.copy()
    success[2] = np.nan
    said = "nothing can be learned from c: no instance has an outcome .* with the parallel gripper"
    with pytest.raises(MismatchError, match=said):
        train(replace(single, success=success), "c")
    success[2, 5] = 1
    truth = data.truth.copy()
    truth[5] = np.nan
    with pytest.raises(InputError, match="is known of none of the 1 instances with an outcome"):
        train(replace(single, success=success, truth=truth), "c")
    poses = data.estimates.cam_T_obj.copy()
    poses[2, :, :3, 3] *= 1000
    metres = replace(single, estimates=replace(data.estimates, cam_T_obj=poses))
    with pytest.raises(InputError, match="poses by c cannot be"):
        train(metres, "c")
