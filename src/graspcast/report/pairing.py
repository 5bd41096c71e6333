"""Pairing of verdicts with trials: which campaign's trials were guided by their very poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import polars as pl

from graspcast.bop.results import Results, read_results
from graspcast.estimates.alignment import estimate_ids
from graspcast.estimates.outcomes import TRIAL_COLUMNS
from graspcast.evaluation.verdict_scores import verdict_table
from graspcast.forecasting.verdict import VerdictRow
from graspcast.report.trials import Trials

__all__ = ["Paired", "outcomes_of"]

_SAME_POSE = 1e-6


@dataclass(frozen=True, eq=False)
class Paired:
    """The trials whose outcomes are those of some verdicts.

    Attributes
    ----------
    outcomes
        The trials, with their number among those of the run.
    problems
        What could not be paired, in words.
    """

    outcomes: tuple[tuple[int, Trials], ...] = ()
    problems: tuple[str, ...] = ()

    @property
    def table(self) -> pl.DataFrame | None:
        """All outcomes as one table; None if there are none."""
        if not self.outcomes:
            return None
        return pl.concat([trials.table for _, trials in self.outcomes])


def outcomes_of(
    rows: Sequence[VerdictRow],
    trials: Sequence[Trials],
    results: Mapping[str, Path],
    path: Path,
) -> Paired:
    """Return the trials that the verdicts' own poses guided.

    Trials belong to verdicts by the whole key of a trial. Where several campaigns hold the same
    trial, poses fused from two views and from three for example, those belong to the verdicts of
    which the campaign states a results file with the verdicts' poses.

    Parameters
    ----------
    rows
        Verdicts of one file and look.
    trials
        Of the run.
    results
        Names of results files to where they are.
    path
        The verdicts' file, for messages.
    """
    keys = verdict_table(rows).select(TRIAL_COLUMNS)
    found: list[tuple[int, Trials]] = []
    problems: list[str] = []
    for name in keys["estimator"].unique().sort().to_list():
        mine = keys.filter(estimator=name)
        candidates = [
            (number, one, held)
            for number, one in enumerate(trials)
            if len(held := _about(one.table.filter(estimator=name), mine))
        ]
        if len(candidates) > 1 and _overlap([held for *_, held in candidates]):
            same = [c for c in candidates if _guided(rows, name, c[1], results)]
            if not same or (len(same) > 1 and _overlap([held for *_, held in same])):
                files = ", ".join(str(one.path) for _, one, _ in candidates)
                problems.append(
                    f"{files}: hold outcomes of the same trials of {name}, and which are of the "
                    f"poses in {path} is not known; name the outcomes of each run"
                )
                continue
            candidates = same
        found += [(number, one) for number, one, _ in candidates]
    # A table with several estimators is a candidate for each of them, but is joined once.
    return Paired(tuple({number: (number, one) for number, one in found}.values()), tuple(problems))


def _about(table: pl.DataFrame, keys: pl.DataFrame) -> pl.DataFrame:
    """Return the keys of the trials in a table that are about some verdicts."""
    stated = table.select(TRIAL_COLUMNS).with_columns(pl.col("est_id").fill_null(0))
    return stated.join(keys, on=TRIAL_COLUMNS, how="semi")


def _overlap(tables: Sequence[pl.DataFrame]) -> bool:
    """Return whether one trial is in several tables."""
    together = pl.concat(tables)
    return together.n_unique() < len(together)


def _guided(
    rows: Sequence[VerdictRow], name: str, trials: Trials, results: Mapping[str, Path]
) -> bool:
    """Return whether the poses of verdicts are those of the file that guided the trials."""
    file = trials.sources.get(name)
    path = None if file is None else results.get(file)
    if path is None:
        return False
    poses = _poses(path)
    pairs = [
        (row.cam_T_obj, poses[place])
        for row in rows
        if row.principal == name
        and (place := (row.key.scene_id, row.key.im_id, row.key.obj_id, row.key.est_id)) in poses
    ]
    if not pairs:
        return False
    mine, theirs = (np.stack(side) for side in zip(*pairs, strict=True))
    return bool(np.abs(mine - theirs).max() < _SAME_POSE)


@lru_cache(maxsize=8)
def _poses(path: Path) -> dict[tuple[int, int, int, int], np.ndarray]:
    table: Results = read_results(path)
    columns = (table.scene_id, table.im_id, table.obj_id, estimate_ids(table))
    places = zip(*(column.tolist() for column in columns), strict=True)
    return dict(zip(places, table.cam_T_obj, strict=True))
