"""Pose errors against success."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from graspcast.bop.dataset import BopDataset
from graspcast.estimates.outcomes import ERROR_COLUMNS, error_numbers
from graspcast.report.error_sizes import all_trials, error_section, obj_T_est
from graspcast.report.run_data import RunData
from graspcast.report.trials import Trials
from poses import write_models


def test_bins_hold_all_trials_and_small_errors_succeed(run: RunData) -> None:
    shift, turn = error_section(run.trials, {}).figures
    total = sum(len(one.table) for one in run.trials)
    assert sum(row[2] for row in shift.rows) == total == sum(row[2] for row in turn.rows)  # type: ignore[misc]
    rates = {row[0]: row[3] for row in shift.rows}
    assert rates[2.0] == 1.0 and rates[30.0] == 0.0 and shift.columns[0] == "from_mm"
    table = all_trials(run.trials)
    size = 1e3 * np.linalg.norm(obj_T_est(table)[:, :3, 3], axis=1)
    small = table.filter(pl.Series((size >= 2) & (size < 5)))
    assert rates[2.0] == pytest.approx(small["success"].mean())
    assert "symmetries are not taken into account" in turn.caption


def test_symmetries_count_where_there_are_models(run: RunData, tmp_path: Path) -> None:
    half = np.diag([-1.0, -1.0, 1.0, 1.0])
    info = {"symmetries_discrete": [half.ravel().tolist()]}
    write_models(tmp_path / "d" / "models", obj_1=info)
    dataset = BopDataset(tmp_path / "d")
    numbers = error_numbers(half[None])[0]
    table = (
        run.trials[0]
        .table.head(1)
        .with_columns(
            obj_id=pl.lit(1),
            **{name: pl.lit(x) for name, x in zip(ERROR_COLUMNS, numbers.tolist(), strict=True)},
        )
    )
    trials = [Trials(run.trials[0].path, table)]
    assert error_section(trials, {}).figures[1].rows[-1][0] > 1.0  # type: ignore[operator]
    (row,) = error_section(trials, {"d": dataset}).figures[1].rows
    assert row[0] == 0.0 and row[2] == 1


def test_nothing_is_said_where_no_error_is_stated(run: RunData) -> None:
    table = run.trials[0].table.with_columns(error_x_m=pl.lit(None, pl.Float64))
    assert error_section([Trials(run.trials[0].path, table)], {}).is_empty
    assert error_section([], {}).is_empty
