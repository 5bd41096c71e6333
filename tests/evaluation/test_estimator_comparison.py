"""Comparing principals and supporters of known quality."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose

from graspcast import ForestSettings, compare
from graspcast.bop.models import Models
from graspcast.errors import InputError, MismatchError
from graspcast.evaluation.cross_validation import cross_validated
from graspcast.evaluation.estimator_comparison import Comparison
from graspcast.evaluation.paired_differences import FORECAST_MEASURES, PRINCIPAL_MEASURES
from graspcast.evaluation.scores import score
from poses import write_models
from supporters import EstimatorWorld

FORESTS = ForestSettings(trees=8, draws=16, folds=0)
FAST: dict[str, Any] = {"folds": 3, "bootstrap": 100, "forests": FORESTS}


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Models]:
    folder = write_models(tmp_path_factory.mktemp("models"), obj_1={}, obj_2={})
    return {"made": Models(folder)}


@pytest.fixture(scope="module")
def found(models: dict[str, Models]) -> Comparison:
    world = EstimatorWorld.make()
    return compare([world.training_data("a"), world.training_data("b")], models=models, **FAST)


# --- Supporters -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_an_informative_supporter_improves_forecasts_and_noise_does_not(found: Comparison) -> None:
    principal = found.principals["a"]
    informative, noise = principal.without["b"].improvement, principal.without["c"].improvement
    assert informative["auroc"].low > 0.2
    assert informative["aurc"].low > 0.1
    assert informative["success_at_50"].low > 0.1
    assert not noise["aurc"].excludes_zero
    assert abs(noise["aurc"].value) < 0.02
    assert abs(noise["auroc"].value) < 0.05
    # It suffices alone, and noise alone does not.
    assert not principal.alone["b"].improvement["aurc"].excludes_zero
    assert principal.alone["c"].improvement["aurc"].low > 0.1


@pytest.mark.slow
def test_the_principal_that_is_right_more_often_is_first(found: Comparison) -> None:
    assert found.ranking == ("b", "a")
    assert found.improvement["b", "a"]["success"].low > 0.2
    assert found.improvement["b", "a"]["aurc"].excludes_zero


@pytest.mark.slow
def test_paired_differences_are_antisymmetric(found: Comparison, models: dict[str, Models]) -> None:
    for measure in PRINCIPAL_MEASURES:
        one, other = found.improvement["a", "b"][measure], found.improvement["b", "a"][measure]
        assert_allclose((one.value, one.low, one.high), (-other.value, -other.high, -other.low))
        better = -1 if measure == "aurc" else 1
        difference = found.common_scores["a"][measure] - found.common_scores["b"][measure]
        assert one.value == pytest.approx(better * difference)


@pytest.mark.slow
def test_the_order_of_principals_does_not_matter(
    found: Comparison, models: dict[str, Models]
) -> None:
    world = EstimatorWorld.make()
    turned = compare([world.training_data("b"), world.training_data("a")], models=models, **FAST)
    assert turned.improvement == found.improvement


@pytest.mark.slow
def test_scores_are_those_of_forecasts_without_the_supporter(
    found: Comparison, models: dict[str, Models]
) -> None:
    world = EstimatorWorld.make()
    principal = found.principals["a"]
    success = world.training_data("a").tried().own_success == 1
    values = {}
    for names in ("abc", "ab"):
        given = dataclasses.replace(world, poses={n: world.poses[n] for n in names}, names=names)
        p = cross_validated(given.training_data("a"), models=models, folds=3, forests=FORESTS)
        values[names] = score(p, success, np.zeros(len(p)))
    for name in FORECAST_MEASURES:
        assert principal.scores[name] == pytest.approx(getattr(values["abc"], name))
        assert principal.without["c"].scores[name] == pytest.approx(getattr(values["ab"], name))
    gain = values["ab"].aurc - values["abc"].aurc
    assert principal.without["c"].improvement["aurc"].value == pytest.approx(gain)
    assert (principal.n, principal.without_forecast, principal.scenes) == (240, 0, 12)


# --- Any number of estimators ---------------------------------------------------------------------


@pytest.mark.parametrize(
    "names", ["ab", "abc", *(pytest.param("abcdef"[:n], marks=pytest.mark.slow) for n in (4, 6))]
)
@pytest.mark.slow
def test_two_to_six_estimators(names: str, models: dict[str, Models]) -> None:
    world = EstimatorWorld.make(60, names, scenes=6, tried="a")
    heard: list[float] = []
    options = {**FAST, "folds": 2, "bootstrap": 5}
    options["forests"] = ForestSettings(trees=4, draws=4, folds=0)
    found = compare(
        [world.training_data("a")],
        models=models,
        progress=lambda share, _: heard.append(share),
        **options,
    )
    principal = found.principals["a"]
    supporters = list(names[1:]) if len(names) > 2 else []
    assert list(principal.without) == list(principal.alone) == supporters
    assert heard == sorted(heard)
    assert heard[-1] == pytest.approx(1)
    if names == "abc":  # one without the other is it alone
        assert principal.without["b"] == principal.alone["c"]
    json.dumps(found.as_dict(), allow_nan=False)


@pytest.mark.slow
def test_principals_that_share_no_instance_are_not_ranked(models: dict[str, Models]) -> None:
    world = EstimatorWorld.make(120, scenes=6)
    early = (pl.col("estimator") == "a") & (pl.col("scene_id") < 3)
    late = (pl.col("estimator") == "b") & (pl.col("scene_id") >= 3)
    some = dataclasses.replace(world, outcomes=world.outcomes.filter(early | late))
    options = {**FAST, "folds": 2, "bootstrap": 5}
    found = compare([some.training_data("a"), some.training_data("b")], models=models, **options)
    assert found.common == 0
    assert found.ranking == ()
    assert found.common_scores == found.improvement == {}
    json.dumps(found.as_dict(), allow_nan=False)


def test_what_cannot_be_compared_is_refused(models: dict[str, Models]) -> None:
    world = EstimatorWorld.make(60, scenes=6)
    a, b = world.training_data("a"), world.training_data("b")
    with pytest.raises(InputError, match="0 principals"):
        compare([])
    with pytest.raises(InputError, match="1 folds"):
        compare([a], folds=1)
    with pytest.raises(MismatchError, match="two training data of a"):
        compare([a, a])
    with pytest.raises(MismatchError, match="of b have a, b, c and the other gripper"):
        compare([a, dataclasses.replace(b, gripper="other")])
    with pytest.raises(MismatchError, match="of b have a, b and the parallel gripper"):
        compare([a, b.only("a", "b")])
    with pytest.raises(MismatchError, match="6 scenes cannot make 7 folds"):
        compare([a], models=models, folds=7)
    with pytest.raises(MismatchError, match="a is the principal, but not among b, c"):
        a.only("b", "c")
