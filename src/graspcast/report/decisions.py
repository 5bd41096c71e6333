"""Decisions of a run: every verdict after every look, with the outcome of the grasp it is about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from graspcast.errors import MismatchError
from graspcast.estimates.outcomes import ERROR_COLUMNS, TRIAL_COLUMNS, join_outcomes
from graspcast.evaluation.threshold_trials import threshold_in_use
from graspcast.evaluation.verdict_scores import verdict_table
from graspcast.report.looks import LookRows
from graspcast.report.pairing import outcomes_of
from graspcast.report.trials import DETAILS, Trials

__all__ = ["Decisions", "decide_on"]


@dataclass(frozen=True, eq=False)
class Decisions:
    """All verdicts of a run.

    Attributes
    ----------
    table
        A row for each instance and look: ``row`` (its number), ``look`` (from 1), ``instance``,
        ``ended`` (whether looking ended there), the trial's key, ``object``, ``scene``, ``said``,
        ``attempt``, ``probability``, ``threshold``, ``unusual``, ``why``, ``views``, ``looks``
        (that were taken), ``success`` (null without an outcome), ``outcome``, the trial's details,
        ``error_m`` and ``error_rad`` (null where not stated).
    poses
        The pose that guides each, ``cam_T_obj``, (n, 4, 4).
    looks
        The verdicts themselves.
    outcomes
        For each of :attr:`looks` and each stage, the outcomes it was joined with; None where there
        are none.
    trials_of
        The trials that each row's outcome is from, by number in the run's trials; -1 without.
    problems
        What could not be joined, in words.
    """

    table: pl.DataFrame
    poses: np.ndarray
    looks: tuple[LookRows, ...]
    outcomes: tuple[tuple[pl.DataFrame | None, ...], ...]
    trials_of: np.ndarray
    problems: tuple[str, ...] = ()

    @property
    def last(self) -> pl.DataFrame:
        """The verdict on each instance at which looking ended."""
        return self.table.filter("ended")

    @property
    def threshold(self) -> float | None:
        """The threshold of all verdicts; None if they state none, or several."""
        return threshold_in_use(
            [row for looks in self.looks for stage in looks.stages for row in stage]
        )

    def at(self, look: int) -> pl.DataFrame:
        """Return the verdicts after a number of looks."""
        return self.table.filter(look=look)

    @property
    def most_looks(self) -> int:
        """After how many looks there are verdicts."""
        return int(self.table["look"].max() or 0)  # type: ignore[arg-type]


def decide_on(
    looks: Sequence[LookRows], trials: Sequence[Trials], results: dict[str, Path]
) -> Decisions:
    """Join verdicts with outcomes.

    Parameters
    ----------
    looks
        As :func:`graspcast.report.looks.read_looks` returns them.
    trials
        Of the run.
    results
        Names of results files to where they are, by which several campaigns of one estimator are
        told apart.

    Raises
    ------
    MismatchError
        If an outcome could be of several instances.
    """
    parts, poses, from_trials, problems = [], [], [], []
    joined: list[tuple[pl.DataFrame | None, ...]] = []
    first = 0
    for each in looks:
        mine: list[pl.DataFrame | None] = []
        for stage, rows in enumerate(each.stages):
            table = verdict_table(rows)
            found = outcomes_of(rows, trials, results, each.paths[stage])
            problems += [text for text in found.problems if text not in problems]
            full, numbers = _with_outcomes(table, found.outcomes)
            more = _described(each, stage, first)
            parts.append(pl.concat([more, full], how="horizontal"))
            poses.append(np.stack([row.cam_T_obj for row in rows]))
            from_trials.append(numbers)
            mine.append(found.table)
        joined.append(tuple(mine))
        first += len(each.stages[0])
    return Decisions(
        table=pl.concat(parts).with_row_index("row"),
        poses=np.concatenate(poses),
        looks=tuple(looks),
        outcomes=tuple(joined),
        trials_of=np.concatenate(from_trials),
        problems=tuple(problems),
    )


def _described(each: LookRows, stage: int, first: int) -> pl.DataFrame:
    """Return what verdicts say beside the columns of :func:`verdict_table`."""
    rows = each.stages[stage]
    verdicts = [row.verdict for row in rows]
    return pl.DataFrame(
        {
            "look": pl.Series([stage + 1] * len(rows), dtype=pl.Int64),
            "instance": pl.Series(range(first, first + len(rows)), dtype=pl.Int64),
            "ended": pl.Series((each.ended == stage).tolist(), dtype=pl.Boolean),
            "object": pl.Series([row.key.object for row in rows], dtype=pl.String),
            "scene": pl.Series(
                [f"{row.key.dataset}/{row.key.scene_id}" for row in rows], dtype=pl.String
            ),
            "said": pl.Series([str(v) for v in verdicts], dtype=pl.String),
            "threshold": pl.Series([v.threshold for v in verdicts], dtype=pl.Float64),
            "unusual": pl.Series([bool(v.out_of_distribution) for v in verdicts]),
            "why": pl.Series([v.reason for v in verdicts], dtype=pl.String),
            "views": pl.Series([row.views for row in rows], dtype=pl.Int64),
            "looks": pl.Series(each.taken[stage].tolist(), dtype=pl.Int64),
        }
    )


def _with_outcomes(
    table: pl.DataFrame, outcomes: Sequence[tuple[int, Trials]]
) -> tuple[pl.DataFrame, np.ndarray]:
    """Return verdicts with success and details, and the number of the trials of each."""
    numbers = np.full(len(table), -1)
    empty: dict[str, Any] = {"success": pl.Int64, **DETAILS}
    full = table.with_columns(pl.lit(None, kind).alias(name) for name, kind in empty.items())
    for number, trials in outcomes:
        try:
            success = join_outcomes(table, trials.table)["success"]
        except pl.exceptions.PolarsError as error:
            raise MismatchError(
                f"{trials.path}: cannot be joined with the verdicts ({error})",
                parameters=("outcomes",),
            ) from error
        keyed = trials.table.with_columns(pl.col("est_id").fill_null(0)).drop("success")
        details = table.join(keyed, on=TRIAL_COLUMNS, how="left", maintain_order="left")
        known = success.is_not_null()
        numbers[known.to_numpy()] = number
        full = full.with_columns(
            pl.when(known).then(found.cast(empty[name])).otherwise(pl.col(name)).alias(name)
            for name, found in [("success", success), *((n, details[n]) for n in DETAILS)]
        )
    shift, turn = (
        sum((pl.col(name) ** 2 for name in names), pl.lit(0.0)).sqrt()
        for names in (ERROR_COLUMNS[:3], ERROR_COLUMNS[3:])
    )
    return full.with_columns(error_m=shift, error_rad=turn), numbers
