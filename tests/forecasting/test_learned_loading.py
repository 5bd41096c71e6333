"""Loading of estimators that are learned from, but not needed at run time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.loading import Inputs
from graspcast.forecasting.learned_loading import load_learned
from graspcast.forecasting.training_data import TrainingData
from looked_at import Training, training


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Training:
    return training(tmp_path_factory.mktemp("models"))


@pytest.fixture(scope="module")
def outcomes(given: Training) -> pl.DataFrame:
    keys = given.data.estimates.instances.frame()
    return pl.concat(
        keys.with_columns(
            estimator=pl.lit(name),
            gripper=pl.lit("parallel"),
            success=pl.Series(held.astype(np.int64)),
        )
        for name, held in zip(given.data.estimates.estimators, given.data.success, strict=True)
    )


def alone(given: Training, outcomes: pl.DataFrame) -> tuple[Inputs, TrainingData]:
    """All three estimators' results, and training data of a alone."""
    inputs = Inputs({}, {"d": given.results})
    estimates = inputs.estimates("a", only=("a",))
    data = TrainingData.join(estimates, outcomes, "a", "parallel", truth=given.data.truth)
    return inputs, data


def test_it_is_what_complete_data_say(given: Training, outcomes: pl.DataFrame) -> None:
    inputs, data = alone(given, outcomes)
    found = load_learned(inputs, data, outcomes, ("c", "b", "c")).learned
    expected = replace(given.data, views=None).learning_from("b", "c").learned
    assert found is not None and expected is not None
    assert found.estimators == expected.estimators == ("b", "c")
    assert_allclose(found.cam_T_obj, expected.cam_T_obj)
    assert_array_equal(found.success, expected.success)
    count = len(data)
    said = f"also learned from: {count} outcomes of b, {count} outcomes of c; the model will not"
    assert inputs.notes == [f"{said} need these"]
    step = load_learned(inputs, data, outcomes, ("c",))
    again = load_learned(inputs, step, outcomes, ("b",)).learned
    assert again is not None and again.estimators == ("b", "c")
    assert_array_equal(again.success, expected.success)
    assert load_learned(inputs, data, outcomes, ()) is data


def test_what_it_did_not_find_has_no_outcome_and_stays(
    given: Training, outcomes: pl.DataFrame
) -> None:
    table = given.results["c"]
    part = given._replace(results={**given.results, "c": table.select(table.scene_id > 1)})
    inputs, data = alone(part, outcomes)
    learned = load_learned(inputs, data, outcomes, ("c",)).learned
    assert learned is not None and len(data) == len(given.data)
    lacks = data.estimates.scene_id == 1
    assert_array_equal(np.isnan(learned.success[0]), lacks)
    assert_array_equal(learned.usable(data.truth)[0], ~lacks)
    assert not any("dropped" in note for note in inputs.notes)


def test_whom_nothing_can_be_learned_from_is_told(given: Training, outcomes: pl.DataFrame) -> None:
    inputs, data = alone(given, outcomes)
    with pytest.raises(InputError, match="a is the principal"):
        load_learned(inputs, data, outcomes, ("a",))
    with pytest.raises(UnknownNameError, match="unknown estimator 'e'; known: a, b, c"):
        load_learned(inputs, data, outcomes, ("e",))
    with pytest.raises(MismatchError, match="nothing can be learned from b without outcomes"):
        load_learned(inputs, data, None, ("b",))
    own = outcomes.filter(pl.col("estimator") == "a")
    with pytest.raises(MismatchError, match="from b: no instance has an outcome"):
        load_learned(inputs, data, own, ("b",))
    unknown = replace(data, truth=np.full_like(data.truth, np.nan))
    with pytest.raises(InputError, match="the true pose is known of none of the 120 instances"):
        load_learned(inputs, unknown, outcomes, ("b",))


def test_of_several_instances_in_an_image_its_outcomes_are_not_used(
    given: Training, outcomes: pl.DataFrame
) -> None:
    table = given.results["c"]
    first = (table.scene_id == 1) & (table.im_id == 0)
    twice = table.select(np.concatenate([np.arange(len(first)), np.flatnonzero(first)]))
    poses = twice.cam_T_obj.copy()
    poses[len(first) :, 0, 3] += 0.3
    more = replace(twice, cam_T_obj=poses, line=np.arange(len(twice)) + 2)
    inputs, data = alone(given._replace(results={**given.results, "c": more}), outcomes)
    learned = load_learned(inputs, data, outcomes, ("c",)).learned
    assert learned is not None
    estimates = data.estimates
    assert_array_equal(
        np.isnan(learned.success[0]), (estimates.scene_id == 1) & (estimates.im_id == 0)
    )
