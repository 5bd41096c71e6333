"""Table of covariances of fused poses, as ``fuse`` writes it, read for other uses."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError, InputError, MismatchError, UnknownNameError
from graspcast.estimates.instances import KEY_COLUMNS, KEY_SCHEMA, InstanceKey
from graspcast.io.arguments import PATH, checked
from graspcast.io.tables import read_csv, read_parquet
from graspcast.pose.covariances import check_covariance

__all__ = ["CovarianceTable", "read_covariances"]

_UPPER = tuple(zip(*np.triu_indices(6), strict=True))


@dataclass(frozen=True, eq=False)
class CovarianceTable:
    """Covariances of poses in the axes of their objects.

    Attributes
    ----------
    objects
        ``dataset-number`` of each pose's object, (n,).
    covariance
        Of position (m) and rotation vector (rad), about the object's origin, (n, 6, 6).
    source
        The file's name.
    keys
        The instance of each pose; empty where the table does not name them.
    """

    objects: ndarray
    covariance: Float[ndarray, "n 6 6"]
    source: str
    keys: tuple[InstanceKey, ...] = ()

    def __len__(self) -> int:
        return len(self.objects)

    def of(self, name: str) -> CovarianceTable:
        """Select the poses of an object.

        Raises
        ------
        UnknownNameError
            If there is none.
        """
        mine = self.objects == name
        if not mine.any():
            known = sorted(set(self.objects.tolist()))
            raise UnknownNameError("object", name, known, hint=f"{self.source} has poses of these")
        keys = tuple(key for key, is_mine in zip(self.keys, mine, strict=False) if is_mine)
        return CovarianceTable(self.objects[mine], self.covariance[mine], self.source, keys)

    def at(self, key: InstanceKey) -> Float[ndarray, "6 6"]:
        """Return the covariance of an instance's pose.

        Raises
        ------
        MismatchError
            If the table has none.
        """
        if key not in self._rows:
            raise MismatchError(
                f"{self.source}: has no covariance of {key}", parameters=("covariances",)
            )
        return np.asarray(self.covariance[self._rows[key]])

    @cached_property
    def _rows(self) -> dict[InstanceKey, int]:
        return {key: row for row, key in enumerate(self.keys)}

    def mean(self) -> Float[ndarray, "6 6"]:
        """Return the mean covariance: that of an error of a pose drawn at random."""
        return np.asarray(self.covariance.mean(axis=0))


@checked(path=PATH)
def read_covariances(path: str | PathLike[str]) -> CovarianceTable:
    """Read the table that ``FusedEstimates.table`` gives, CSV or Parquet.

    Raises
    ------
    FormatError
        If a column is missing, or a row is not the covariance of a pose; the message names the row.
    """
    path = Path(path)
    frame = read_parquet(path) if path.suffix == ".parquet" else read_csv(path)
    names = [f"cov_obj_{i}{j}" for i, j in _UPPER]
    missing = [n for n in (*KEY_COLUMNS[:1], "obj_id", *names) if n not in frame.columns]
    if missing:
        raise FormatError(
            path, f"has no column {missing[0]}; a table of covariances is one that fuse writes"
        )
    if not len(frame):
        raise FormatError(path, "has no row")
    try:
        values = frame.select(pl.col(names).cast(pl.Float64)).to_numpy()
        objects = frame.select(pl.format("{}-{}", "dataset", "obj_id")).to_series()
    except pl.exceptions.PolarsError as error:
        raise FormatError(path, f"holds something that is no number: {error}") from error
    matrix = np.zeros((len(frame), 6, 6))
    for column, (i, j) in enumerate(_UPPER):
        matrix[:, i, j] = matrix[:, j, i] = values[:, column]
    for row, each in enumerate(matrix):
        try:
            check_covariance(each)
        except InputError as error:
            raise FormatError(path, str(error), where=f"row {row + 1}") from error
    return CovarianceTable(objects.to_numpy().astype(str), matrix, str(path), _keys(path, frame))


def _keys(path: Path, frame: pl.DataFrame) -> tuple[InstanceKey, ...]:
    """Return the instances that the rows name; none where a column is missing."""
    if any(name not in frame.columns for name in KEY_COLUMNS):
        return ()
    try:
        columns = frame.select(pl.col(name).cast(kind) for name, kind in KEY_SCHEMA.items())
    except pl.exceptions.PolarsError as error:
        raise FormatError(path, f"holds a key that is no whole number: {error}") from error
    return tuple(InstanceKey(*row) for row in columns.rows())
