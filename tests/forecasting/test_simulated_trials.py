"""Simulated trials of one gripper, of one grasp or several."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
from numpy.testing import assert_array_equal

import synthetic
from graspcast.estimates.outcomes import ERROR_COLUMNS, error_numbers
from graspcast.forecasting.models.targets import Targets
from graspcast.forecasting.simulated_trials import SimulatedTrials


def written(path: Path, grasps: list[str] | None) -> Path:
    trials = synthetic.error_outcomes(4, "d-1")
    errors = zip(ERROR_COLUMNS, error_numbers(trials.obj_T_est).T, strict=True)
    columns = {"dataset": ["d"] * 4, "obj_id": [1] * 4, "gripper": ["p", "p", "q", "p"]}
    named = {} if grasps is None else {"grasp": grasps}
    table = {**columns, **named, "success": trials.success.astype(int), **dict(errors)}
    pl.DataFrame(table).write_csv(path)
    return path


def test_trials_name_their_grasps(tmp_path: Path) -> None:
    path = written(tmp_path / "t.csv", ["top", "side", "top", "reference"])
    trials = SimulatedTrials.read([path], "p")
    assert trials.names.tolist() == ["top", "side", "reference"]
    assert trials.pairs == {("d-1", "top"), ("d-1", "side"), ("d-1", "reference")}
    targets = Targets.of([("d-1", "top"), ("d-1", "reference")])
    assert_array_equal(trials.targets(targets), [1, -1, 0])
    assert trials.select(np.array([True, False, True])).names.tolist() == ["top", "reference"]


def test_without_the_column_they_are_of_the_reference_grasp(tmp_path: Path) -> None:
    trials = SimulatedTrials.read([written(tmp_path / "t.csv", None)], "q")
    assert trials.names.tolist() == ["reference"]
    assert synthetic.error_outcomes(2, "d-1").names.tolist() == ["reference"] * 2
