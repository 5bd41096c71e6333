"""Trials with observed outcomes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from bop_images import estimates_of, write_dataset
from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import InputError, UnknownNameError
from graspcast.simulation.grasps.observed_trials import observed_trials


@pytest.fixture
def dataset(tmp_path: Path) -> BopDataset:
    return write_dataset(tmp_path / "made")


@pytest.fixture
def results(dataset: BopDataset) -> Results:
    return estimates_of(dataset)


def outcomes_of(results: Results, success: list[bool]) -> pl.DataFrame:
    table = pl.DataFrame(
        {
            "scene_id": results.scene_id,
            "im_id": results.im_id,
            "obj_id": results.obj_id,
            "success": success,
        }
    )
    return table.with_columns(
        estimator=pl.lit("a"),
        dataset=pl.lit("made"),
        est_id=pl.lit(0, pl.Int64),
        gripper=pl.lit("parallel"),
        grasp=pl.lit("reference"),
    )


def test_each_outcome_stays_with_its_estimate(dataset: BopDataset, results: Results) -> None:
    success = [True, False, False, True, True, False]
    # The last estimate was not tried, and outcomes come in another order.
    outcomes = outcomes_of(results, success)[:5].reverse()
    found = observed_trials({"made": {"a": results}}, {"made": dataset}, outcomes)
    keys = found.requests.keys
    expected = {
        (s, i, o): ok
        for s, i, o, ok in outcomes.select("scene_id", "im_id", "obj_id", "success").rows()
    }
    rows = keys.select("scene_id", "im_id", "obj_id").rows()
    assert dict(zip(rows, found.success.tolist(), strict=True)) == expected
    whole = [found.of("made-1", "parallel", split) for split in ("train", "validation", "test")]
    assert sum(len(part.success) for part in whole) == sum(key[2] == 1 for key in expected)
    truth = dataset.ground_truth
    (at,) = np.flatnonzero(
        (truth.scene_id == rows[0][0]) & (truth.im_id == rows[0][1]) & (truth.obj_id == rows[0][2])
    )
    relative = np.linalg.inv(truth.cam_T_obj[at]) @ results.cam_T_obj[at]
    np.testing.assert_allclose(found.requests.obj_T_est[0], relative, atol=1e-12)


def test_names_without_trials_are_refused(dataset: BopDataset, results: Results) -> None:
    outcomes = outcomes_of(results, 6 * [True])
    found = observed_trials({"made": {"a": results}}, {"made": dataset}, outcomes)
    with pytest.raises(UnknownNameError, match="made-1 by claw"):
        found.of("made-1", "claw", "train")
    elsewhere = outcomes.with_columns(scene_id=pl.col("scene_id") + 40)
    with pytest.raises(InputError, match="no estimate has an outcome"):
        observed_trials({"made": {"a": results}}, {"made": dataset}, elsewhere)
