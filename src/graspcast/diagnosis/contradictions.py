"""Outcome tables that are refused since they have trials with both outcomes."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from graspcast.diagnosis.finding import Finding
from graspcast.errors import GraspcastError
from graspcast.estimates.outcomes import TRIAL_COLUMNS
from graspcast.io.tables import read_csv

__all__ = ["repeated_in_one"]


def repeated_in_one(path: Path, error: GraspcastError) -> Finding | None:
    """Say that a table that is refused has trials with both outcomes, if it has some."""
    if "share their trial" not in str(error) or path.suffix != ".csv":
        return None
    raw = read_csv(path)
    keys = [name for name in (*TRIAL_COLUMNS, "inst_id") if name in raw.columns]
    outcomes = raw.group_by(keys).agg(n=pl.len(), kinds=pl.col("success").n_unique())
    wrong = outcomes.filter(pl.col("kinds") > 1)
    if not len(wrong):
        return None
    return Finding(
        "error",
        "outcomes-contradict",
        str(path),
        f"{len(wrong)} of {int((outcomes['n'] > 1).sum())} trials that come twice have both "
        "outcomes",
        "Leave one row of each trial, or add est_id where images show an object several times",
        {"contradicting": len(wrong)},
    )
