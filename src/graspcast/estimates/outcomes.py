"""Outcomes of grasp trials as a table: which estimate guided which grasp, and whether it held.

Columns: ``estimator, dataset, scene_id, im_id, obj_id, est_id, gripper, grasp, success``.
``est_id`` (:mod:`graspcast.estimates.instances`) may be left out where no image shows an object
twice, and ``grasp`` where there is one grasp for each object and gripper. Files of former versions
call ``est_id`` ``inst_id``; it is read as the same.
"""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError, MismatchError
from graspcast.estimates.instances import KEY_SCHEMA, Instances
from graspcast.io.arguments import PATH, checked
from graspcast.io.tables import read_csv, read_parquet
from graspcast.pose.transforms import rotation_from_vector, rotation_vector, transform

__all__ = [
    "ERROR_COLUMNS",
    "REFERENCE_GRASP",
    "TRIAL_COLUMNS",
    "TRIAL_SCHEMA",
    "checked_outcomes",
    "error_numbers",
    "errors_of_each",
    "join_outcomes",
    "read_all_outcomes",
    "read_error_outcomes",
    "read_outcomes",
    "success_of_each",
]

TRIAL_SCHEMA: dict[str, Any] = {
    "estimator": pl.String,
    **KEY_SCHEMA,
    "gripper": pl.String,
    "grasp": pl.String,
}
"""The key of a trial, which estimate guided which grasp by which gripper, with types."""

TRIAL_COLUMNS = tuple(TRIAL_SCHEMA)
"""The names of its columns."""

REFERENCE_GRASP = "reference"
"""The name of the one reference grasp of an object and gripper."""

ERROR_COLUMNS = (
    "error_x_m",
    "error_y_m",
    "error_z_m",
    "error_rx_rad",
    "error_ry_rad",
    "error_rz_rad",
)
"""The error that guided a trial: origin and rotation vector of ``inv(cam_T_gt) @ cam_T_est``."""

_OPTIONAL = ("est_id", "grasp")
_IMAGE_OF_OBJECT = ["dataset", "scene_id", "im_id", "obj_id"]


@checked(path=PATH)
def read_outcomes(path: str | PathLike[str]) -> pl.DataFrame:
    """Read outcomes from CSV, Parquet, or a directory of Parquet shards (a campaign).

    Returns
    -------
        The columns of :data:`TRIAL_COLUMNS`, ``success`` (0 or 1) and, if the file has them all,
        :data:`ERROR_COLUMNS`; further columns are left out. ``est_id`` is null where the file does
        not state it. A file of a former version keeps its ``inst_id``, which is ``est_id`` too.

    Raises
    ------
    FormatError
        Naming the file, the column or row, and the remedy.
    """
    path = Path(path)
    frame = _read(path)
    if {"inst_id", "est_id"} <= set(frame.columns):
        raise FormatError(path, "has both est_id and inst_id, its former name; leave one out")
    return checked_outcomes(frame, source=path)


def checked_outcomes(
    frame: pl.DataFrame, *, source: str | PathLike[str] = "the outcomes"
) -> pl.DataFrame:
    """Check a table of outcomes, and bring its columns into the form of :func:`read_outcomes`.

    Parameters
    ----------
    frame
        The table.
    source
        Where it is from, for messages.

    Raises
    ------
    FormatError
        Naming the column or row, and the remedy.
    """
    if "est_id" not in frame.columns and "inst_id" in frame.columns:
        frame = frame.with_columns(est_id=pl.col("inst_id"))
    kinds: dict[str, Any] = {**TRIAL_SCHEMA, "success": pl.Int64}
    if "inst_id" in frame.columns:
        kinds["inst_id"] = pl.Int64
    if set(ERROR_COLUMNS) <= set(frame.columns):
        kinds |= dict.fromkeys(ERROR_COLUMNS, pl.Float64)
    missing = [name for name in kinds if name not in frame.columns and name not in _OPTIONAL]
    if missing:
        found = ", ".join(frame.columns)
        raise FormatError(source, f"no column {', '.join(map(repr, missing))}; found {found}")
    added = {"est_id": pl.lit(None, pl.Int64), "grasp": pl.lit(REFERENCE_GRASP)}
    frame = frame.with_columns(**{k: v for k, v in added.items() if k not in frame.columns})
    for name, kind in kinds.items():
        column = frame[name]
        # A cast would cut the fraction off.
        fractional = column.dtype.is_float() or column.dtype.is_decimal()
        if kind == pl.Int64 and fractional and (cut := column % 1 != 0).any():
            row = cut.arg_true()[0]
            raise FormatError(
                source, f"{name} is {column[row]}, not a whole number", where=f"row {row + 1}"
            )
    try:
        frame = frame.select(pl.col(name).cast(kind) for name, kind in kinds.items())
    except pl.exceptions.PolarsError as error:
        first = str(error).splitlines()[0]
        raise FormatError(source, f"a column does not hold what it should ({first})") from error
    _check_values(frame, source)
    return frame


def _check_values(frame: pl.DataFrame, source: str | PathLike[str]) -> None:
    """Raise for an empty field, a success that is not 0 or 1, or two outcomes of one trial."""
    for name in (*TRIAL_COLUMNS, "success"):
        empty = frame[name].is_null()
        if empty.any() and name != "est_id":
            raise FormatError(
                source, f"an empty field: {name}", where=f"row {empty.arg_true()[0] + 1}"
            )
    wrong = ~frame["success"].is_in([0, 1])
    if wrong.any():
        row = wrong.arg_true()[0]
        raise FormatError(
            source, f"success is {frame['success'][row]}, not 0 or 1", where=f"row {row + 1}"
        )
    _check_repeated(frame, source)


def _check_repeated(frame: pl.DataFrame, source: str | PathLike[str]) -> None:
    # A trial without est_id is one of an object that its image shows once: est_id 0.
    keys = frame.select(TRIAL_COLUMNS).with_columns(pl.col("est_id").fill_null(0))
    twice = frame.filter(keys.is_duplicated())
    if len(twice):
        hint = "leave one row of each trial"
        if twice["est_id"].is_null().any():
            hint += ", or, where images show an object several times, add a column est_id"
        if "fused" in twice["estimator"]:
            hint += (
                "; poses fused from different numbers of looks are simulated as estimators of "
                "their own: fused2, fused3"
            )
        raise FormatError(
            source,
            f"{len(twice)} rows share their trial with another: {_described(twice)}; {hint}",
        )


def read_all_outcomes(paths: Iterable[str | PathLike[str]]) -> pl.DataFrame:
    """Read outcomes from several files or directories as one table.

    Raises
    ------
    FormatError
        Naming the file that is wrong, or the files that hold the same trial.
    """
    paths = list(paths)
    table = pl.concat([read_outcomes(path) for path in paths], how="diagonal")
    _check_repeated(table, ", ".join(map(str, paths)))
    return table


def join_outcomes(
    keys: pl.DataFrame, outcomes: pl.DataFrame, *, others: pl.DataFrame | None = None
) -> pl.DataFrame:
    """Join a table with the outcomes of its trials, by the whole key of a trial.

    Parameters
    ----------
    keys
        A table that has :data:`TRIAL_COLUMNS` among its columns.
    outcomes
        As :func:`read_outcomes` returns them.
    others
        Keys of further instances that the outcomes could be of.

    Returns
    -------
        The rows of ``keys``, in their order, with ``success``: 1, 0, or null without an outcome;
        and with :data:`ERROR_COLUMNS` where the outcomes have them.

    Raises
    ------
    MismatchError
        If the outcomes do not state ``est_id`` and there are several instances of an object in one
        image, so that an outcome could be of any of them.
    InputError
        If the outcomes are not a table of outcomes.
    """
    on = TRIAL_COLUMNS
    errors = [name for name in ERROR_COLUMNS if name in outcomes.columns]
    tried = checked_outcomes(outcomes).select(*on, "success", *errors)
    unstated = tried.filter(pl.col("est_id").is_null())
    if len(unstated):
        known = (
            keys.select(on) if others is None else pl.concat([keys.select(on), others.select(on)])
        )
        several = known.filter(pl.col("est_id") > 0).join(
            unstated, on=["estimator", *_IMAGE_OF_OBJECT, "gripper"], how="semi"
        )
        if len(several):
            row = several.row(0, named=True)
            raise MismatchError(
                f"image {row['scene_id']}/{row['im_id']} has several instances of "
                f"{row['dataset']}-{row['obj_id']}, but the outcomes have no column est_id: which "
                "one was tried is not known; add the column, the rank of the estimate by score",
                parameters=("outcomes",),
            )
        tried = tried.with_columns(pl.col("est_id").fill_null(0))
    return keys.join(tried, on=on, how="left", validate="m:1", maintain_order="left")


def success_of_each(
    instances: Instances,
    outcomes: pl.DataFrame,
    estimator: str,
    gripper: str,
    *,
    grasp: str = REFERENCE_GRASP,
    others: Instances | None = None,
) -> Float[ndarray, " n"]:
    """Return the outcome of the grasp of each instance that an estimator guided.

    Parameters
    ----------
    instances
        Those whose outcomes are wanted.
    outcomes
        As :func:`read_outcomes` returns them.
    estimator, gripper, grasp
        Who guided which grasp by which gripper.
    others
        Further instances that the outcomes could be of.

    Returns
    -------
        1 for success, 0 for failure, NaN where there is no outcome, (n,).

    Raises
    ------
    MismatchError
        As :func:`join_outcomes`.
    """
    found = _joined(instances, outcomes, estimator, gripper, grasp, others)["success"]
    return found.cast(pl.Float64).fill_null(float("nan")).to_numpy()


def errors_of_each(
    instances: Instances,
    outcomes: pl.DataFrame,
    estimator: str,
    gripper: str,
    *,
    grasp: str = REFERENCE_GRASP,
) -> Float[ndarray, "n 4 4"]:
    """Return the error that guided the trial of each instance, where the outcomes state it.

    Parameters
    ----------
    instances, outcomes, estimator, gripper, grasp
        As for :func:`success_of_each`.

    Returns
    -------
        ``obj_T_est``, NaN where it is not stated, (n, 4, 4).
    """
    out = np.full((len(instances), 4, 4), np.nan)
    if not set(ERROR_COLUMNS) <= set(outcomes.columns):
        return out
    found = _joined(instances, outcomes, estimator, gripper, grasp)
    numbers = found.select(pl.col(ERROR_COLUMNS).fill_null(float("nan"))).to_numpy()
    stated = np.isfinite(numbers).all(axis=1)
    out[stated] = _errors(numbers[stated])
    return out


def error_numbers(obj_T_est: Float[ndarray, "n 4 4"]) -> Float[ndarray, "n 6"]:
    """Return the values of :data:`ERROR_COLUMNS` for some errors, metres and radians."""
    return np.concatenate([obj_T_est[:, :3, 3], rotation_vector(obj_T_est[:, :3, :3])], axis=1)


def read_error_outcomes(
    path: str | PathLike[str],
) -> tuple[pl.DataFrame, Float[ndarray, "n 4 4"]]:
    """Read outcomes together with the errors that guided the trials (a campaign has them).

    Returns
    -------
        ``object`` (``dataset-obj_id``), ``gripper``, ``grasp``, ``success`` (bool); and
        ``obj_T_est``.

    Raises
    ------
    FormatError
        As :func:`read_outcomes`, or if the errors' columns are missing.
    """
    path = Path(path)
    frame = _read(path)
    needed = ("dataset", "obj_id", "gripper", "success", *ERROR_COLUMNS)
    missing = [name for name in needed if name not in frame.columns]
    if missing:
        raise FormatError(
            path,
            f"no column {', '.join(map(repr, missing))}; give a campaign of simulated trials",
        )
    named = "grasp" in frame.columns
    grasp = pl.col("grasp").cast(pl.String) if named else pl.lit(REFERENCE_GRASP).alias("grasp")
    try:
        numbers = frame.select(pl.col(name).cast(pl.Float64) for name in ERROR_COLUMNS).to_numpy()
        table = frame.select(
            pl.format("{}-{}", "dataset", "obj_id").alias("object"),
            pl.col("gripper").cast(pl.String),
            grasp,
            pl.col("success").cast(pl.Boolean),
        )
    except pl.exceptions.PolarsError as error:
        first = str(error).splitlines()[0]
        raise FormatError(path, f"a column does not hold what it should ({first})") from error
    bad = ~np.isfinite(numbers).all(axis=1) | table.select(
        pl.any_horizontal(pl.all().is_null())
    ).to_series().to_numpy().astype(bool)
    if bad.any():
        raise FormatError(path, "an empty field", where=f"row {int(np.argmax(bad)) + 1}")
    return table, _errors(numbers)


def _errors(numbers: Float[ndarray, "n 6"]) -> Float[ndarray, "n 4 4"]:
    return transform(rotation_from_vector(numbers[:, 3:]), numbers[:, :3])


def _joined(
    instances: Instances,
    outcomes: pl.DataFrame,
    estimator: str,
    gripper: str,
    grasp: str,
    others: Instances | None = None,
) -> pl.DataFrame:
    who = {"estimator": pl.lit(estimator), "gripper": pl.lit(gripper), "grasp": pl.lit(grasp)}
    further = None if others is None else others.frame().with_columns(**who)
    return join_outcomes(instances.frame().with_columns(**who), outcomes, others=further)


def _described(trials: pl.DataFrame) -> str:
    """Return the key of the first trial, for a message."""
    row = trials.select(TRIAL_COLUMNS).row(0, named=True)
    return ", ".join(f"{name} {value}" for name, value in row.items() if value is not None)


def _read(path: Path) -> pl.DataFrame:
    if path.is_dir():
        whole = path / "outcomes.parquet"
        shards = [whole] if whole.is_file() else sorted(path.glob("**/*.parquet"))
        if not shards:
            raise FormatError(path, "no Parquet files in this directory")
        parts = [read_parquet(shard) for shard in shards]
        try:
            return pl.concat(parts)
        except pl.exceptions.PolarsError as error:
            raise FormatError(path, "its Parquet files have different columns") from error
    return read_parquet(path) if path.suffix == ".parquet" else read_csv(path)
