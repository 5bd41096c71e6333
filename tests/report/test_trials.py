"""Trials of a run."""

from __future__ import annotations

from pathlib import Path

import polars as pl
import pytest

from graspcast.errors import FormatError
from graspcast.estimates.outcomes import ERROR_COLUMNS
from graspcast.io.artefacts import write_artefact
from graspcast.report.trials import DETAILS, read_trials
from graspcast.simulation.campaign.store import COLUMNS
from small_run import outcomes, verdicts


def test_a_table_with_and_without_details(tmp_path: Path) -> None:
    rows = verdicts(1)
    outcomes(rows).write_csv(tmp_path / "all.csv")
    found = read_trials(tmp_path / "all.csv")
    assert len(found.table) == len(rows) and set(DETAILS) <= set(found.table.columns)
    assert (found.table["outcome"] == "held").sum() == int(found.table["success"].sum())
    assert found.table["error_x_m"].null_count() == 0
    assert found.protocol == "" and found.sources == {} and found.estimators == ["a"]
    outcomes(rows, details=False).write_parquet(tmp_path / "few.parquet")
    few = read_trials(tmp_path / "few.parquet")
    assert few.table["outcome"].null_count() == len(rows)


def test_a_campaign_says_its_protocol_and_who_guided(tmp_path: Path) -> None:
    table = outcomes(verdicts(1)).with_columns(pl.col("success").cast(pl.Boolean))
    missing = {n: k for n, k in COLUMNS.items() if n not in table.columns}
    table = table.with_columns(pl.lit(None, kind).alias(name) for name, kind in missing.items())
    table = table.with_columns(pl.col("offset_m").fill_null(float("nan")))
    table = table.select(pl.col(name).cast(kind) for name, kind in COLUMNS.items())
    directory = tmp_path / "trials"
    directory.mkdir()
    table.write_parquet(directory / "outcomes.parquet")
    manifest = {
        "configuration": {"graspcast": "0"},
        "sources": {"a on d": "elsewhere/a_d-test.csv"},
        "setups": [{"protocol": "robot"}, {"protocol": "robot"}],
    }
    write_artefact(directory / "manifest.json", manifest)
    found = read_trials(directory)
    assert found.protocol == "robot" and found.sources == {"a": "a_d-test.csv"}
    assert found.table["offset_m"].null_count() == len(table)
    assert found.table.select(ERROR_COLUMNS).null_count().sum_horizontal()[0] == 0


def test_a_table_that_is_wrong_is_refused(tmp_path: Path) -> None:
    table = outcomes(verdicts(1)).with_columns(success=pl.lit(2))
    table.write_csv(tmp_path / "wrong.csv")
    with pytest.raises(FormatError, match="success is 2"):
        read_trials(tmp_path / "wrong.csv")
