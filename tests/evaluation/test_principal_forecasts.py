"""Cross-validated forecasts for each principal: their instances, and which principals there are."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from graspcast.bop.results import write_results
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.loading import Inputs, load_inputs
from graspcast.evaluation.principal_forecasts import (
    PrincipalForecasts,
    common_rows,
    principal_training_data,
)
from poses import results_of
from supporters import EstimatorWorld
from synthetic import with_keys


def inputs(folder: Path, world: EstimatorWorld) -> Inputs:
    paths = []
    for name, poses in world.poses.items():
        table = dataclasses.replace(
            results_of(poses), scene_id=world.scene, obj_id=1 + np.arange(world.n) % 2
        )
        paths.append((name, folder / f"{name}_made-test.csv"))
        write_results(paths[-1][1], table)
    return load_inputs(paths)


def test_principals_are_the_estimators_with_outcomes(tmp_path: Path) -> None:
    world = EstimatorWorld.make(60, scenes=6)
    given = inputs(tmp_path, world)
    outcomes = world.outcomes.filter((pl.col("estimator") == "a") | (pl.col("scene_id") < 3))
    found = principal_training_data(given, outcomes, "parallel", with_truth=False)
    assert [each.principal for each in found] == ["a", "b"]
    assert all(each.estimates.estimators == ("a", "b", "c") for each in found)
    assert [len(each.tried()) for each in found] == [60, 30]
    assert any("outcome of c " in n and "only a supporter" in n for n in given.notes)
    assert "30 instances have no outcome of b" in given.notes


def test_missing_ground_truth_is_an_error_unless_none_is_wanted(tmp_path: Path) -> None:
    world = EstimatorWorld.make(60, scenes=6)
    with pytest.raises(
        InputError, match=r"need ground truth: none of the instances .* direct, which"
    ):
        principal_training_data(inputs(tmp_path, world), world.outcomes, "parallel")


def test_without_outcomes_there_is_no_principal(tmp_path: Path) -> None:
    world = EstimatorWorld.make(60, scenes=6)
    given = inputs(tmp_path, world)
    with pytest.raises(UnknownNameError, match="unknown gripper 'vacuum'; known: parallel"):
        principal_training_data(given, world.outcomes, "vacuum", with_truth=False)
    elsewhere = world.outcomes.with_columns(scene_id=pl.col("scene_id") + 100)
    with pytest.raises(MismatchError, match="of the same dataset and scenes"):
        principal_training_data(given, elsewhere, "parallel", with_truth=False)


def test_only_instances_with_every_forecast_are_kept() -> None:
    data = EstimatorWorld.make(60, scenes=6).training_data("a")
    full, alone = np.full(60, 0.5), np.full(60, 0.5)
    full[:10], alone[5:20] = np.nan, np.nan
    found = PrincipalForecasts.of(data, {("b", "c"): full, ("b",): alone})
    assert found.without_forecast == 20
    assert len(found.full) == len(found.forecasts["b",]) == 40
    assert found.rows["made", 2, 20, 1] == 0
    with pytest.raises(InputError, match="no forecast for any instance of a"):
        PrincipalForecasts.of(data, {("b", "c"): np.full(60, np.nan)})


def test_common_rows_are_of_the_same_instances() -> None:
    world = EstimatorWorld.make(60, scenes=6)
    first, second = np.full(60, 0.5), np.full(60, 0.5)
    first[:10], second[30:] = np.nan, np.nan
    found = [
        PrincipalForecasts.of(world.training_data("a"), {("b", "c"): first}),
        PrincipalForecasts.of(world.training_data("b"), {("a", "c"): second}),
    ]
    one, other = common_rows(found)
    assert one.tolist() == list(range(20))
    assert other.tolist() == list(range(10, 30))


def test_of_several_instances_in_an_image_none_is_common() -> None:
    data = EstimatorWorld.make(60, scenes=6).training_data("a")
    est_id = np.zeros(60, np.int64)
    est_id[7] = 1
    columns = {name: getattr(data.estimates, name).copy() for name in ("im_id", "obj_id")}
    for column in columns.values():
        column[7] = column[5]
    data = dataclasses.replace(data, estimates=with_keys(data.estimates, est_id=est_id, **columns))
    found = PrincipalForecasts.of(data, {("b", "c"): np.full(60, 0.5)})
    assert len(found.full) == 60
    assert len(found.rows) == 58
