"""What other thresholds would be worth: attempts, successes and net benefit at stated costs."""

from __future__ import annotations

import polars as pl

from graspcast.evaluation.net_benefit import Costs
from graspcast.evaluation.threshold_table import ThresholdRow, advice, threshold_table
from graspcast.evaluation.threshold_trials import threshold_in_use, trials_of_verdicts
from graspcast.report.content import Cell, Section, Table
from graspcast.report.decisions import Decisions
from graspcast.report.forecast_quality import after
from graspcast.report.looks import LookRows
from graspcast.report.rates import DRAWS, interval_cell

__all__ = ["thresholds_section"]


def thresholds_section(decisions: Decisions, costs: Costs) -> Section:
    """Return the section of thresholds; empty without outcomes.

    Parameters
    ----------
    decisions
        Of a run.
    costs
        In units of the gain of a success.
    """
    title = "What other thresholds would be worth"
    tables, told = [], []
    for number, looks in enumerate(decisions.looks):
        outcomes = decisions.outcomes[number][-1]
        if outcomes is None:
            continue
        found = _table(number, looks, outcomes, costs, len(decisions.looks) > 1)
        if found is not None:
            tables.append(found[0])
            told.append(found[1])
    if not tables:
        return Section("thresholds", title)
    return Section("thresholds", title, tuple(told), tuple(tables))


def _table(
    number: int, looks: LookRows, outcomes: pl.DataFrame, costs: Costs, named: bool
) -> tuple[Table, str] | None:
    rows = looks.stages[-1]
    trials = trials_of_verdicts(rows, outcomes)
    if not len(trials.probability):
        return None
    found = threshold_table(trials, costs, asked=threshold_in_use(rows), draws=DRAWS)
    of = f"{looks.paths[-1].name}, " if named else ""
    told = f"verdicts {after(most, most)}" if (most := len(looks.stages)) > 1 else "verdicts"
    table = Table(
        key=f"thresholds-{number + 1}",
        caption=f"What {of}the {told} would do from other thresholds on. Net benefit of a grasp at "
        f"costs: {costs}.",
        columns=("threshold", "attempted", "attempts", "succeed", "views", "net benefit", "which"),
        rows=tuple(_row(row) for row in found.rows),
        numeric=(*(True for _ in range(6)), False),
    )
    return table, advice(found)


def _row(row: ThresholdRow) -> tuple[Cell, ...]:
    marks = {"in use": row.asked, "break-even": row.break_even, "best of these": row.best}
    return (
        Cell.of(row.threshold),
        Cell.of(row.attempted),
        Cell.of(row.attempts),
        interval_cell(row.success),
        Cell.of(row.looks, 2),
        Cell(f"{row.net_benefit:+.3f}", row.net_benefit),
        Cell(", ".join(mark for mark, holds in marks.items() if holds) or "-"),
    )
