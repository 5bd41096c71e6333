"""Outcome tables: contradictions, trials of other estimates, and scenes in two roles."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import polars as pl

from graspcast.diagnosis.case import Case
from graspcast.diagnosis.finding import Finding
from graspcast.estimates.outcomes import ERROR_COLUMNS, TRIAL_COLUMNS
from graspcast.io.wording import counted

__all__ = ["outcome_findings", "shared_scenes"]

_LEAST = 20
_SAME_POSE = 1e-6  # metres or radians
_LARGEST_ERROR_M, _LARGEST_ERROR_RAD = 2.0, 4.0


def outcome_findings(case: Case, tables: Mapping[Path, pl.DataFrame]) -> Iterator[Finding]:
    """Compare outcome tables with each other, and with the estimates."""
    for path, table in tables.items():
        yield from _alone(path, table)
        yield from _unmatched(case, path, table)
    for (one, first), (other, second) in combinations(tables.items(), 2):
        if one.with_suffix("") == other.with_suffix("") and first.equals(second):
            continue  # one table in two formats
        yield from _two(one, first, other, second)


def _keyed(table: pl.DataFrame, more: Sequence[str]) -> pl.DataFrame:
    return table.select(*TRIAL_COLUMNS, "success", *more).with_columns(
        pl.col("est_id").fill_null(0)
    )


def _shared(first: pl.DataFrame, second: pl.DataFrame) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Return the trials that both tables have, and those whose poses are others there."""
    stated = set(ERROR_COLUMNS) <= set(first.columns) & set(second.columns)
    more = ERROR_COLUMNS if stated else ()
    both = _keyed(first, more).join(_keyed(second, more), on=list(TRIAL_COLUMNS), how="inner")
    apart = [(pl.col(name) - pl.col(f"{name}_right")).abs() > _SAME_POSE for name in more]
    other = pl.any_horizontal(*apart, pl.lit(False)).fill_null(False)
    return both.filter(~other), both.filter(other)


def _two(one: Path, first: pl.DataFrame, other: Path, second: pl.DataFrame) -> Iterator[Finding]:
    both, others = _shared(first, second)
    if len(others):
        yield Finding(
            "warning",
            "outcomes-other-poses",
            str(other),
            f"{counted(len(others), 'trial')} of {len(second)} are in {one} too, guided by other "
            f"poses: {_trial(others)}",
            "Give estimators different names, or one of the two tables: trials that come twice "
            "are refused",
            {"other_poses": len(others), "with": str(one)},
        )
    if not len(both):
        return
    wrong = both.filter(pl.col("success") != pl.col("success_right"))
    if len(wrong):
        yield Finding(
            "error",
            "outcomes-contradict",
            str(other),
            f"{len(wrong)} of {len(both)} trials that are in {one} too have the other outcome "
            f"there: {_trial(wrong)}",
            "Keep the table that is right, or give repeated trials a grasp of another name",
            {"contradicting": len(wrong), "shared": len(both), "with": str(one)},
        )
    else:
        yield Finding(
            "warning",
            "outcomes-repeated",
            str(other),
            f"{counted(len(both), 'trial')} of {len(second)} are in {one} too, with the same "
            "outcomes",
            "Give one of the two tables: trials that come twice are refused",
            {"shared": len(both), "with": str(one)},
        )


def _trial(table: pl.DataFrame) -> str:
    row = table.row(0, named=True)
    return (
        f"{row['estimator']}, image {row['scene_id']}/{row['im_id']}, object "
        f"{row['dataset']}-{row['obj_id']}, {row['gripper']}"
    )


def _alone(path: Path, table: pl.DataFrame) -> Iterator[Finding]:
    if len(table) >= _LEAST and table["success"].n_unique() == 1:
        value = int(table["success"][0])
        yield Finding(
            "warning",
            "outcomes-constant",
            str(path),
            f"all {len(table)} outcomes are {value}",
            "Nothing is learned from these: is success written the right way, and by trial?",
            {"success": value, "trials": len(table)},
        )
    if set(ERROR_COLUMNS) <= set(table.columns) and len(table):
        numbers = np.abs(table.select(ERROR_COLUMNS).drop_nulls().to_numpy())
        if not len(numbers):
            return
        metres, radians = np.median(numbers[:, :3].max(axis=1)), np.max(numbers[:, 3:])
        if metres > _LARGEST_ERROR_M or radians > _LARGEST_ERROR_RAD:
            unit = "millimetres" if metres > _LARGEST_ERROR_M else "degrees"
            yield Finding(
                "error",
                "outcomes-unit",
                str(path),
                f"the median error of position is {metres:.3g} m and the largest rotation "
                f"{radians:.3g} rad; are they in {unit}?",
                "Write errors in metres and radians",
                {"median_error_m": float(metres), "largest_rad": float(radians)},
            )


def _unmatched(case: Case, path: Path, table: pl.DataFrame) -> Iterator[Finding]:
    """Say that trials are of images that the estimates do not have."""
    by_name = {name.casefold(): t for name, t in case.results.items() if name not in case.blamed}
    tried = table.filter(pl.col("dataset").str.to_lowercase() == case.name.casefold())
    known = [n for n in tried["estimator"].unique().sort().to_list() if n.casefold() in by_name]
    for name in known:
        mine = tried.filter(pl.col("estimator") == name)
        results = by_name[name.casefold()]
        keys = pl.DataFrame(
            {"scene_id": results.scene_id, "im_id": results.im_id, "obj_id": results.obj_id}
        ).unique()
        of = ["scene_id", "im_id", "obj_id"]
        lacking = mine.select(of).unique().join(keys, on=of, how="anti")
        total = len(mine.select(of).unique())
        if len(lacking) == total and len(results):
            yield Finding(
                "error",
                "outcomes-unmatched",
                str(path),
                f"none of the {total} instances with trials guided by {name} is in "
                f"{results.source}",
                "Give the estimates that guided the trials, or number the images alike",
                {"instances": total, "with": results.source},
                estimator=name,
            )


def shared_scenes(
    training: Mapping[Path, pl.DataFrame], calibration: Mapping[Path, pl.DataFrame]
) -> Iterator[Finding]:
    """Say which scenes are in tables for training and in tables for calibration too."""
    for path, table in calibration.items():
        for other, trained in training.items():
            for unit, severity in (
                (["dataset", "scene_id", "im_id"], "image"),
                (["dataset", "scene_id"], "scene"),
            ):
                mine = table.select(unit).unique()
                shared = mine.join(trained.select(unit).unique(), on=unit, how="semi").sort(unit)
                if not len(shared):
                    continue
                first = "/".join(map(str, shared.row(0)))
                yield Finding(
                    "error" if severity == "image" else "warning",
                    "shared-images" if severity == "image" else "shared-scenes",
                    str(path),
                    f"{len(shared)} of {len(mine)} {severity}s for calibration are in the training "
                    f"table {other} too (the first is {first})",
                    "Calibrate on scenes that nothing was trained on: the guarantee does not hold "
                    "otherwise",
                    {"shared": len(shared), "of": len(mine), "with": str(other)},
                )
                break
