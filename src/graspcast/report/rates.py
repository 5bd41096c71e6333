"""Success rates: of all grasps and of attempts, by object, gripper and grasp, over scenes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import polars as pl

from graspcast.evaluation.bootstrap import Interval, original_and_draws
from graspcast.evaluation.success_intervals import success_interval
from graspcast.evaluation.verdict_scores import VerdictScores, attempt_scores
from graspcast.io.wording import counted
from graspcast.report.content import Cell, Figure, Section, Table
from graspcast.report.decisions import Decisions
from graspcast.report.interval_chart import RateRow, interval_chart
from graspcast.report.text import rate, spread

__all__ = ["DRAWS", "GroupRate", "interval_cell", "rate_of", "rates_by", "rates_section"]

DRAWS = 2000
"""Draws of scenes of every interval."""
_MOST_ROWS = 24


@dataclass(frozen=True)
class GroupRate:
    """Rates in one group.

    Attributes
    ----------
    name
        Of the group, in the words of its columns.
    first
        Of the grasps after one look: ``always`` is their success rate if all are attempted.
    last
        Of the verdicts at which looking ended.
    """

    name: tuple[str, ...]
    first: VerdictScores
    last: VerdictScores


def rate_of(table: pl.DataFrame) -> VerdictScores | None:
    """Return the scores of verdicts with known outcomes; None if there are none.

    Intervals of success rates are those of few scenes
    (:mod:`graspcast.evaluation.success_intervals`).
    """
    known = table.drop_nulls("success")
    if not len(known):
        return None
    scenes, numbers = np.unique(known["scene"].to_numpy(), return_inverse=True)
    counts = original_and_draws(scenes.tolist(), DRAWS, 0)
    success, attempt = known["success"].to_numpy() == 1, known["attempt"].to_numpy()
    scores = attempt_scores(known, draws=DRAWS)
    always = success_interval(np.ones(len(known), dtype=bool), success, numbers, counts)
    return replace(
        scores,
        always=always or scores.always,
        following=success_interval(attempt, success, numbers, counts),
    )


def rates_by(decisions: Decisions, columns: list[str]) -> list[GroupRate]:
    """Return the rates of each group that some columns form, in the order of their names."""
    first, last = decisions.at(1), decisions.last
    out = []
    for names in first.select(columns).unique().sort(columns).rows():
        mine = [
            rate_of(table.filter(**dict(zip(columns, names, strict=True))))
            for table in (first, last)
        ]
        if mine[0] is not None and mine[1] is not None:
            out.append(GroupRate(tuple(map(str, names)), mine[0], mine[1]))
    return out


def interval_cell(interval: Interval | None) -> Cell:
    """Return the cell of a rate and its interval."""
    if interval is None or interval.value != interval.value:
        return Cell.of(None)
    ends = None if interval.ends is None else (interval.low, interval.high)
    return Cell(f"{rate(interval.value)} {spread(interval)}".strip(), interval.value, ends)


def rates_section(decisions: Decisions) -> Section:
    """Return the section of success rates; empty without outcomes."""
    objects = rates_by(decisions, ["object"])
    if not objects:
        return Section("rates", "Success by object, gripper and grasp")
    pairs = rates_by(decisions, ["gripper", "grasp"])
    looked = decisions.most_looks > 1
    said = (
        "Attempted always: every grasp after one look. By the verdicts: those that are attempted "
        "when looking has ended. "
        if looked
        else "Attempted always: every grasp. By the verdicts: those that are attempted. "
    )
    return Section(
        key="rates",
        title="Success by object, gripper and grasp",
        paragraphs=(said + "Intervals are of 95 %, over scenes; those of few scenes are wide.",),
        tables=(
            _table("rates-by-object", "Success rates by object.", ["object"], objects),
            _table(
                "rates-by-gripper-and-grasp",
                "Success rates by gripper and grasp.",
                ["gripper", "grasp"],
                pairs,
            ),
        ),
        figures=(_figure(objects),),
    )


def _table(key: str, caption: str, columns: list[str], rates: list[GroupRate]) -> Table:
    rows = tuple(
        (
            *(Cell.of(name) for name in found.name),
            Cell.of(found.first.n),
            Cell.of(found.first.scenes),
            interval_cell(found.first.always),
            interval_cell(found.last.attempt_rate),
            Cell.of(found.last.attempts),
            interval_cell(found.last.following),
        )
        for found in rates
    )
    names = ("grasps", "scenes", "success always", "attempted", "attempts", "success of attempts")
    numeric = (*(False for _ in columns), *(True for _ in names))
    return Table(key, caption, (*columns, *names), rows, numeric)


def _numbers(interval: Interval | None) -> tuple[float | None, ...]:
    if interval is None:
        return (None, None, None)
    return interval.value, *(interval.ends or (None, None))


def _figure(rates: list[GroupRate]) -> Figure:
    shown = sorted(rates, key=lambda found: -found.first.n)[:_MOST_ROWS]
    shown = [found for found in rates if found in shown]
    more = len(rates) - len(shown)
    left_out = (
        f" The {counted(more, 'object')} with the fewest grasps are left out." if more else ""
    )
    series = ("attempted always", "attempted by the verdicts")
    rows = [RateRow(found.name[0], (found.first.always, found.last.following)) for found in shown]
    return Figure(
        key="success-by-object",
        title="Success rate by object",
        caption=f"Dots are rates, lines 95 % intervals over scenes.{left_out}",
        svg=interval_chart("Success rate of each object", "success rate", series, rows),
        columns=("object", "success_always", "low", "high", "success_of_attempts", "low", "high"),
        rows=tuple(
            (row.name, *(number for found in row.rates for number in _numbers(found)))
            for row in rows
        ),
    )
