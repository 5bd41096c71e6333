"""Outcomes of one or several grasps, joined with instances."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_array_equal

import synthetic
from graspcast.errors import FormatError, MismatchError
from graspcast.estimates.outcomes import checked_outcomes
from graspcast.forecasting.outcome_joining import join_grasps
from graspcast.forecasting.training_data import TrainingData

GIVEN = synthetic.estimates(12)
ONE = synthetic.outcomes_of(GIVEN)


def named(grasp: str, table: pl.DataFrame = ONE) -> pl.DataFrame:
    return table.with_columns(grasp=pl.lit(grasp))


def test_each_grasp_is_joined_by_its_name() -> None:
    top = named("top").with_columns(success=1 - pl.col("success")).filter(pl.col("obj_id") == 1)
    both = checked_outcomes(pl.concat([top, named("reference")]).sample(fraction=1, shuffle=True))
    held, errors = join_grasps(GIVEN, both, "a", "p")
    assert list(held) == ["reference", "top"]
    assert_array_equal(np.isnan(held["top"]), np.tile(GIVEN.obj_id == 2, (3, 1)))
    tried = ~np.isnan(held["top"])
    assert_array_equal(held["top"][tried], 1 - held["reference"][tried])
    assert np.isnan(errors).all()


def test_training_data_have_the_reference_grasp_and_others() -> None:
    data = TrainingData.join(GIVEN, pl.concat([named("top"), named("reference")]), "a", "p")
    assert data.grasps == ("reference", "top")
    assert data.every_success.shape == (2, 3, 12)
    assert_array_equal(data.every_success[0], data.success)
    some = data.select(np.arange(3)).only("a", "b")
    assert some.every_success.shape == (2, 2, 3)
    assert_array_equal(data.of_grasp("top").success, data.others["top"])
    plain = TrainingData.join(GIVEN, ONE, "a", "p")
    assert plain.grasps == ("reference",) and not plain.others
    assert_array_equal(plain.success, data.success)


def test_outcomes_without_a_reference_grasp_are_learned_from_too() -> None:
    data = TrainingData.join(GIVEN, named("top"), "a", "p")
    assert data.grasps == ("top",) and data.is_tried.all()
    assert np.isnan(data.own_success).all()
    assert_array_equal(data.outcome_of(["top"] * 11 + ["tip"])[-1:], [np.nan])


def test_two_outcomes_of_one_grasp_are_refused() -> None:
    with pytest.raises(FormatError, match="share their trial"):
        TrainingData.join(GIVEN, pl.concat([named("top"), named("top")]), "a", "p")


def test_nothing_of_the_principal_is_refused() -> None:
    with pytest.raises(MismatchError, match="no instance has an outcome of a"):
        TrainingData.join(GIVEN, named("top", ONE.filter(pl.col("estimator") == "b")), "a", "p")
