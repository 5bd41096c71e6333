"""Errors against success: how often grasps succeed by how far off the guiding pose was."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import polars as pl

from graspcast.bop.dataset import BopDataset
from graspcast.errors import GraspcastError
from graspcast.estimates.outcomes import ERROR_COLUMNS, TRIAL_COLUMNS
from graspcast.pose.metrics import rotation_error
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.report.content import Figure, Section
from graspcast.report.rate_bars import Bin, rate_bars
from graspcast.report.rates import rate_of
from graspcast.report.trials import Trials

__all__ = ["all_trials", "error_section", "obj_T_est"]

_MILLIMETRES = (0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 50.0, 100.0, np.inf)
_DEGREES = (0.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 60.0, 90.0, np.inf)
_TITLE = "Pose error against success"


def obj_T_est(table: pl.DataFrame) -> np.ndarray:
    """Return the errors of trials that state them, ``obj_T_est``, (n, 4, 4)."""
    numbers = table.select(ERROR_COLUMNS).to_numpy().astype(np.float64)
    return transform(rotation_from_vector(numbers[:, 3:]), numbers[:, :3])


def all_trials(trials: Sequence[Trials]) -> pl.DataFrame:
    """Return all trials as one table, each once for each campaign, with scene and object."""
    columns = [*TRIAL_COLUMNS, "success", "outcome", *ERROR_COLUMNS]
    parts = [
        one.table.select(columns).with_columns(campaign=pl.lit(str(one.path))) for one in trials
    ]
    return pl.concat(parts).with_columns(
        scene=pl.format("{}/{}", "dataset", "scene_id"),
        object=pl.format("{}-{}", "dataset", "obj_id"),
        attempt=pl.lit(True),
    )


def error_section(trials: Sequence[Trials], datasets: Mapping[str, BopDataset]) -> Section:
    """Return the section of errors against success; empty where no trial states its error."""
    if not trials:
        return Section("errors", _TITLE)
    table = all_trials(trials).drop_nulls(ERROR_COLUMNS)
    if not len(table):
        return Section("errors", _TITLE)
    errors = obj_T_est(table)
    shift = 1e3 * np.linalg.norm(errors[:, :3, 3], axis=1)
    turn, aware = _degrees(table, errors, datasets)
    symmetric = (
        "Symmetries are taken into account."
        if aware
        else "Without models, symmetries are not taken into account."
    )
    told = "Above each bar, how many trials; lines are 95 % intervals over scenes."
    return Section(
        key="errors",
        title=_TITLE,
        paragraphs=(
            f"All {len(table):,} trials of the run that state the error of the pose which guided "
            "them, attempted or not.",
        ),
        figures=(
            _figure("error-translation", "Distance of the origins", "mm", shift, table, told),
            _figure(
                "error-rotation",
                "Angle between the rotations",
                "degrees",
                turn,
                table,
                f"{told} {symmetric}",
            ),
        ),
    )


def _degrees(
    table: pl.DataFrame, errors: np.ndarray, datasets: Mapping[str, BopDataset]
) -> tuple[np.ndarray, bool]:
    """Return the angle of each error, and whether symmetries are taken into account."""
    angle, aware = np.empty(len(errors)), True
    identity = np.eye(4)[None]
    names = table["object"].to_numpy()
    for name in np.unique(names):
        mine = names == name
        dataset, _, number = str(name).rpartition("-")
        symmetries = None
        try:
            symmetries = datasets[dataset].models[int(number)].symmetries
        except (KeyError, GraspcastError):
            aware = False
        found = errors[mine]
        angle[mine] = rotation_error(found, np.repeat(identity, len(found), axis=0), symmetries)
    return np.degrees(angle), aware


def _figure(
    key: str, what: str, unit: str, values: np.ndarray, table: pl.DataFrame, caption: str
) -> Figure:
    edges = _MILLIMETRES if unit == "mm" else _DEGREES
    number = np.digitize(values, edges) - 1
    bins = []
    for k, (low, high) in enumerate(pairwise(edges)):
        mine = table.filter(pl.Series(number == k))
        scores = rate_of(mine) if len(mine) else None
        label = f"{low:g}-{high:g}" if np.isfinite(high) else f">{low:g}"
        bins.append(Bin(label, len(mine), None if scores is None else scores.always))
    # Bins beyond the largest error hold nothing.
    while bins and not bins[-1].count:
        bins.pop()
    rows = [
        (
            *(edges[k], None if np.isinf(edges[k + 1]) else edges[k + 1], found.count),
            None if found.rate is None else found.rate.value,
            *((found.rate.ends if found.rate else None) or (None, None)),
        )
        for k, found in enumerate(bins)
    ]
    return Figure(
        key=key,
        title=f"Success by {what[0].lower()}{what[1:]}",
        caption=caption,
        svg=rate_bars(
            f"Success rate by {what.lower()} in {unit}",
            f"{what}, {unit}",
            "success rate",
            bins,
        ),
        columns=(f"from_{unit}", f"to_{unit}", "trials", "success_rate", "low", "high"),
        rows=tuple(rows),
    )
