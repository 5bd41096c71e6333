"""The list of all verdicts, as a table that sorts and as CSV."""

from __future__ import annotations

import polars as pl

from graspcast.report.content import Cell, Section, Table
from graspcast.report.decisions import Decisions

__all__ = ["MOST_IN_CSV", "MOST_SHOWN", "verdicts_section"]

MOST_SHOWN, MOST_IN_CSV = 200, 10_000
"""Rows of the table, and of the CSV behind it."""
_COLUMNS = (
    *("object", "scene_id", "im_id", "est_id", "estimator", "gripper", "grasp", "look", "views"),
    *("probability", "threshold", "said", "ended", "success", "outcome", "error_m", "error_rad"),
    "why",
)


def verdicts_section(decisions: Decisions) -> Section:
    """Return the section of verdicts: those at which looking ended; the CSV has all looks."""
    last = decisions.last
    shown = last.head(MOST_SHOWN)
    rows = tuple(
        (
            Cell.of(row["object"]),
            Cell.of(f"{row['scene_id']}/{row['im_id']}"),
            Cell.of(row["est_id"]),
            Cell.of(row["estimator"]),
            Cell.of(row["gripper"]),
            Cell.of(row["grasp"]),
            Cell.of(row["views"]),
            Cell.of(row["probability"]),
            Cell.of(row["said"]),
            Cell.of(_outcome(row["success"], row["outcome"])),
            Cell.of(None if row["error_m"] is None else 1e3 * row["error_m"], 1),
        )
        for row in shown.iter_rows(named=True)
    )
    everything = decisions.table.select(_COLUMNS)
    kept = everything.head(MOST_IN_CSV)
    ended = ", each when looking had ended" if decisions.most_looks > 1 else ""
    told = f"The first {len(shown)} of {len(last):,}" if len(shown) < len(last) else "All"
    whole = "all" if len(kept) == len(everything) else f"the first {MOST_IN_CSV:,}"
    what = "verdicts after every look" if decisions.most_looks > 1 else "verdicts"
    table = Table(
        key="verdicts",
        caption=f"{told} verdicts{ended}. The CSV holds {whole} {what}, with their reasons.",
        columns=(
            *("object", "image", "est_id", "guide", "gripper", "grasp", "views"),
            *("probability", "verdict", "outcome", "error, mm"),
        ),
        rows=rows,
        numeric=(False, False, True, False, False, False, True, True, False, False, True),
        data=(_COLUMNS, tuple(kept.with_columns(pl.col(pl.Float64).round(6)).rows())),
    )
    return Section("verdicts-list", "The verdicts", tables=(table,))


def _outcome(success: int | None, outcome: str | None) -> str | None:
    if outcome is not None or success is None:
        return outcome
    return "success" if success else "failure"
