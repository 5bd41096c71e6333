"""Lessons: whose outcomes count, and errors that were tried in simulation."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import synthetic
from graspcast.errors import FormatError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.outcomes import ERROR_COLUMNS, error_numbers
from graspcast.forecasting.training_data import SimulatedTrials, as_training_data, training_data

NAMES = ("a", "b", "c")


def outcomes(given: Estimates, seed: int = 0) -> pl.DataFrame:
    rng = np.random.default_rng(seed)
    parts = [
        pl.DataFrame(
            {
                "dataset": given.dataset.tolist(),
                "scene_id": given.scene_id,
                "im_id": given.im_id,
                "obj_id": given.obj_id,
                "est_id": given.est_id,
                "success": rng.integers(0, 2, len(given)),
            }
        ).with_columns(estimator=pl.lit(name), gripper=pl.lit(gripper))
        for name in NAMES
        for gripper in ("parallel", "hand")
    ]
    return pl.concat(parts)


def crowded() -> Estimates:
    """Twelve images of one object; images 3 and 4 show it twice, the others once."""
    given = synthetic.estimates(14, objects=(1,))
    image = np.array([0, 1, 2, 3, 3, 4, 4, 5, 6, 7, 8, 9, 10, 11])
    instance = np.array([0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0])
    return synthetic.with_keys(given, scene_id=np.zeros(14, np.int64), im_id=image, est_id=instance)


def test_other_estimators_outcomes_count_only_where_the_object_appears_once() -> None:
    given = crowded()
    table = outcomes(given)
    learned = training_data(given, table, "b", "parallel")
    several = np.isin(given.im_id, [3, 4])
    mine = table.filter(gripper="parallel")
    for k, name in enumerate(NAMES):
        expected = mine.filter(estimator=name)["success"].to_numpy().astype(float)
        if name != "b":
            expected = np.where(several, np.nan, expected)
        assert_array_equal(learned.success[k], expected)
    assert len(learned.samples) == 14
    assert_array_equal(
        learned.samples.success, mine.filter(estimator="b")["success"].to_numpy() == 1
    )


def test_outcomes_of_other_instances_and_grippers_do_not_matter() -> None:
    given = synthetic.estimates(40)
    kept = given.select(np.arange(40) < 25)
    table = outcomes(given)
    foreign = (pl.col("im_id") >= 25) | (pl.col("gripper") == "hand")
    flipped = table.with_columns(
        success=pl.when(foreign).then(1 - pl.col("success")).otherwise(pl.col("success"))
    )
    assert not flipped.equals(table)
    one, two = (training_data(kept, each, "a", "parallel") for each in (table, flipped))
    assert_array_equal(one.success, two.success)
    assert np.isfinite(one.success).all()
    shuffled = training_data(kept, table.sample(fraction=1, shuffle=True, seed=1), "a", "parallel")
    assert_array_equal(shuffled.success, one.success)


def test_what_is_not_known_is_nan_and_selecting_keeps_rows_together() -> None:
    given = synthetic.estimates(20)
    table = outcomes(given).filter(pl.col("im_id") % 3 == 0)
    truth = synthetic.true_poses(20)
    truth[5] = np.nan
    learned = training_data(given, table, "a", "parallel", truth=truth)
    assert_array_equal(np.isnan(learned.success), np.tile(np.arange(20) % 3 != 0, (3, 1)))
    assert_array_equal(learned.has_truth, np.arange(20) != 5)
    assert learned.samples.untried == 13
    part = learned.select(np.array([9, 5, 0]))
    assert_array_equal(part.estimates.im_id, [9, 5, 0])
    assert_array_equal(part.has_truth, [True, False, True])
    assert_array_equal(part.success, learned.success[:, [9, 5, 0]])
    nothing = training_data(given, None, "a", "parallel")
    assert np.isnan(nothing.success).all()
    assert not nothing.has_truth.any()
    with pytest.raises(MismatchError, match=r"no instance has an outcome of a with the parallel"):
        nothing.samples  # noqa: B018


def test_unknown_names() -> None:
    given = synthetic.estimates(6)
    with pytest.raises(UnknownNameError, match=r"unknown estimator 'z'; known: a, b, c"):
        training_data(given, outcomes(given), "z", "parallel")
    with pytest.raises(UnknownNameError, match=r"'paralel' .did you mean 'parallel'"):
        training_data(given, outcomes(given), "a", "paralel")


def test_samples_are_lessons_of_the_principal_alone() -> None:
    samples = dataclasses.replace(synthetic.samples(30), principal="b")
    learned = as_training_data(samples)
    assert_array_equal(learned.success[1], samples.success)
    assert np.isnan(learned.success[[0, 2]]).all()
    assert not learned.has_truth.any()
    assert_array_equal(learned.samples.success, samples.success)
    assert as_training_data(learned) is learned


# --- Simulated trials -----------------------------------------------------------------------------


def campaign(path: Path, trials: SimulatedTrials, gripper: str) -> Path:
    names = [name.rpartition("-") for name in trials.objects.tolist()]
    frame = pl.DataFrame(
        {
            "estimator": "borrowed",
            "dataset": [dataset for dataset, _, _ in names],
            "scene_id": 0,
            "im_id": np.arange(len(trials)),
            "obj_id": [int(number) for _, _, number in names],
            "gripper": gripper,
            "success": trials.success.astype(int),
        }
    ).with_columns(
        pl.Series(name, column)
        for name, column in zip(ERROR_COLUMNS, error_numbers(trials.obj_T_est).T, strict=True)
    )
    path.mkdir()
    frame.write_parquet(path / "outcomes.parquet")
    return path


def test_simulated_trials_of_one_gripper_from_several_campaigns(tmp_path: Path) -> None:
    first, second, other = (
        synthetic.error_outcomes(n, name, seed=n)
        for n, name in ((20, "d-1"), (30, "e-2"), (9, "d-1"))
    )
    paths = [
        campaign(tmp_path / "one", first, "parallel"),
        campaign(tmp_path / "two", second, "parallel"),
        campaign(tmp_path / "three", other, "hand"),
    ]
    found = SimulatedTrials.read(paths, "parallel")
    assert len(found) == 50
    assert found.objects.tolist() == ["d-1"] * 20 + ["e-2"] * 30
    assert_allclose(found.obj_T_est, np.concatenate([first.obj_T_est, second.obj_T_est]), atol=1e-9)
    assert_array_equal(found.success, np.concatenate([first.success, second.success]))
    chosen = found.select(found.objects == "e-2")
    assert_array_equal(chosen.success, second.success)
    assert len(SimulatedTrials.read(paths, "hand")) == 9
    with pytest.raises(
        MismatchError, match=r"no simulated trial of the foot gripper; there are of hand, parallel"
    ):
        SimulatedTrials.read(paths, "foot")
    with pytest.raises(FormatError, match=r"none"):
        SimulatedTrials.read([tmp_path / "none.parquet"], "parallel")
