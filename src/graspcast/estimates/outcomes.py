"""Outcomes of grasp trials as a table: which estimate, which gripper, held or not.

Columns: ``estimator, dataset, scene_id, im_id, obj_id, gripper, success`` and, where an image shows
several instances of an object, ``est_id`` (0 where it is absent): the rank by score of the
detection among those of its object in its image.
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

from graspcast.errors import FormatError, InputError
from graspcast.io.tables import read_csv, read_parquet
from graspcast.pose.transforms import rotation_from_vector, rotation_vector, transform

__all__ = [
    "ERROR_COLUMNS",
    "KEYS",
    "error_numbers",
    "read_all_outcomes",
    "read_error_outcomes",
    "read_outcomes",
]

KEYS = ("estimator", "dataset", "scene_id", "im_id", "obj_id", "est_id", "gripper")
ERROR_COLUMNS = (
    "error_x_m",
    "error_y_m",
    "error_z_m",
    "error_rx_rad",
    "error_ry_rad",
    "error_rz_rad",
)
"""Which error guided a trial: origin and rotation vector of ``inv(cam_T_true) @ cam_T_est``."""

_COLUMNS: dict[str, Any] = {
    "estimator": pl.String,
    "dataset": pl.String,
    "scene_id": pl.Int64,
    "im_id": pl.Int64,
    "obj_id": pl.Int64,
    "gripper": pl.String,
    "success": pl.Int64,
}


def read_outcomes(path: str | PathLike[str]) -> pl.DataFrame:
    """Read outcomes from CSV, Parquet, or a directory of Parquet shards (a campaign).

    Returns
    -------
        The columns of :data:`KEYS` and ``success`` (0 or 1); further columns are left out.

    Raises
    ------
    FormatError
        Naming the file, the column or row, and the remedy.
    """
    path = Path(path)
    frame = _read(path)
    missing = [name for name in _COLUMNS if name not in frame.columns]
    if missing:
        raise FormatError(
            path, f"no column {', '.join(map(repr, missing))}; found {', '.join(frame.columns)}"
        )
    if "est_id" not in frame.columns:
        frame = frame.with_columns(est_id=pl.lit(0, pl.Int64))
    kinds = {**_COLUMNS, "est_id": pl.Int64}
    for name, kind in kinds.items():
        column = frame[name]
        # A cast would cut the fraction off.
        if kind == pl.Int64 and column.dtype.is_float() and (cut := column % 1 != 0).any():
            row = cut.arg_true()[0]
            raise FormatError(
                path, f"{name} is {column[row]}, not a whole number", where=f"row {row + 1}"
            )
    try:
        frame = frame.select(pl.col(name).cast(kinds[name]) for name in (*KEYS, "success"))
    except pl.exceptions.PolarsError as error:
        first = str(error).splitlines()[0]
        raise FormatError(path, f"a column does not hold what it should ({first})") from error
    bad = frame.with_row_index("row").filter(
        pl.any_horizontal(pl.all().is_null()) | ~pl.col("success").is_in([0, 1])
    )
    if len(bad):
        row = bad.row(0, named=True)
        raise FormatError(
            path,
            "an empty field, or a success that is neither 0 nor 1",
            where=f"row {row['row'] + 1}",
        )
    twice = frame.filter(frame.select(KEYS).is_duplicated())
    if len(twice):
        values = ", ".join(f"{k} {v}" for k, v in twice.select(KEYS).row(0, named=True).items())
        raise FormatError(path, f"{len(twice)} rows share their trial with another: {values}")
    return frame


def read_all_outcomes(paths: Iterable[str | PathLike[str]]) -> pl.DataFrame:
    """Read outcomes from several files or directories as one table.

    Raises
    ------
    FormatError
        Naming the file that is wrong.
    InputError
        If two of them hold the same trial.
    """
    paths = list(paths)
    table = pl.concat([read_outcomes(path) for path in paths])
    if table.select(KEYS).is_duplicated().any():
        raise InputError(f"{', '.join(map(str, paths))}: hold some trials twice")
    return table


def error_numbers(obj_T_est: Float[ndarray, "n 4 4"]) -> Float[ndarray, "n 6"]:
    """What :data:`ERROR_COLUMNS` say of an error: metres, and radians."""
    return np.concatenate([obj_T_est[:, :3, 3], rotation_vector(obj_T_est[:, :3, :3])], axis=1)


def read_error_outcomes(
    path: str | PathLike[str],
) -> tuple[pl.DataFrame, Float[ndarray, "n 4 4"]]:
    """Read outcomes together with the errors that guided the trials (a campaign has them).

    Returns
    -------
        ``object`` (``dataset-number``), ``gripper``, ``success`` (bool); and ``obj_T_est``.

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
            f"no column {', '.join(map(repr, missing))}; give a campaign of graspcast simulate",
        )
    try:
        numbers = frame.select(pl.col(name).cast(pl.Float64) for name in ERROR_COLUMNS).to_numpy()
        table = frame.select(
            pl.format("{}-{}", "dataset", "obj_id").alias("object"),
            pl.col("gripper").cast(pl.String),
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
    return table, transform(rotation_from_vector(numbers[:, 3:]), numbers[:, :3])


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
