"""Protocols with several views: nothing of a test instance is learned, and the fallbacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from graspcast.errors import InputError
from graspcast.evaluation.benchmark import Benchmark
from graspcast.evaluation.scores import score
from graspcast.evaluation.view_fusion import fuse_benchmark
from graspcast.evaluation.view_protocols import (
    FoldForecasts,
    ViewFold,
    forecast_fold,
    train_fold,
    view_folds,
)
from graspcast.evaluation.view_sets import ViewModelRule, ViewRow
from viewed import SMALL, benchmark

ROWS = [
    ViewRow("3 views", 3),
    ViewRow("alone", 3, ViewModelRule(alone="b")),
    ViewRow("averaged", 3, averaged=True),
    ViewRow("wrong", 3, other_images=True),
]
Answers = dict[tuple[str, str], FoldForecasts]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Benchmark:
    found, sources = benchmark(tmp_path_factory.mktemp("models"))
    return replace(found, views=fuse_benchmark(sources, found.estimates, ROWS))


def first_fold(whole: Benchmark) -> ViewFold:
    return next(view_folds(whole, "several_views", "p"))


def answers(fold: ViewFold) -> Answers:
    models = train_fold(fold, [row.rule for row in ROWS], SMALL)
    return {(f.row.name, f.principal): f for f in forecast_fold(fold, models, ROWS)}


@pytest.fixture(scope="module")
def found(whole: Benchmark) -> Answers:
    return answers(first_fold(whole))


def test_folds_hold_every_principal_and_test_each_instance_once(whole: Benchmark) -> None:
    tested: dict[str, list[int]] = {name: [] for name in "abc"}
    for fold in view_folds(whole, "several_views", "p"):
        assert list(fold.tasks) == ["a", "b", "c"]
        for name, task in fold.tasks.items():
            rows = whole.rows_of(task.test)
            tested[name] += rows.tolist()
            assert task.views is not None
            learned = whole.rows_of(task.annotated)[task.views.train[ViewModelRule()].row]
            assert not set(learned.tolist()) & set(rows.tolist())
            for each in task.views.test.values():
                assert set(each.data.row.tolist()) <= set(range(len(task.test)))
    assert all(sorted(rows) == list(range(len(whole))) for rows in tested.values())


@pytest.mark.slow
def test_forecasts_do_not_depend_on_outcomes_and_truth_of_the_tested(
    whole: Benchmark, found: Answers
) -> None:
    tested = whole.rows_of(first_fold(whole).first.test)
    keys = whole.estimates.instances.frame()[tested].with_columns(tested=True)
    flipped = whole.outcomes.join(keys, on=keys.columns[:-1], how="left", maintain_order="left")
    flip = pl.when("tested").then(1 - pl.col("success")).otherwise("success").alias("success")
    truth = whole.truth.copy()
    truth[tested, :3, 3] += 0.1
    other = replace(
        whole, outcomes=flipped.with_columns(flip).drop("tested"), truth=truth, _joined={}
    )
    again = answers(first_fold(other))
    for key, each in found.items():
        np.testing.assert_array_equal(each.probability, again[key].probability)
        np.testing.assert_array_equal(each.one_view, again[key].one_view)


def test_views_show_what_one_view_does_not(whole: Benchmark, found: Answers) -> None:
    fold = first_fold(whole)
    each = found["3 views", "a"]
    test = fold.tests["a"]
    success, objects = test.own_success[each.which] == 1, test.objects[each.which]
    assert score(each.probability, success, objects).auroc > 0.9
    assert score(each.one_view, success, objects).auroc < 0.8


def test_one_estimator_alone_forecasts_its_own_grasps(found: Answers) -> None:
    assert {p for name, p in found if name == "alone"} == {"b"}


def test_averages_and_contradictions_use_the_forecast_from_one_view(found: Answers) -> None:
    views, mean = found["3 views", "a"], found["averaged", "a"]
    np.testing.assert_allclose(mean.probability, (views.probability + views.one_view) / 2)
    wrong = found["wrong", "a"]
    assert (wrong.probability == wrong.one_view).mean() > 0.5


def test_poses_of_several_views_are_needed(whole: Benchmark) -> None:
    with pytest.raises(InputError, match="several views"):
        next(view_folds(replace(whole, views=None), "several_views", "p"))


def test_objects_are_left_out_in_turn(whole: Benchmark) -> None:
    folds = list(view_folds(whole, "several_views_unseen_object", "p"))
    assert [fold.first.left_out for fold in folds] == ["d-1", "d-2"]
    for fold in folds:
        assert set(fold.tests["a"].objects.tolist()) == {fold.first.left_out}
        assert fold.first.left_out not in fold.first.annotated.objects
