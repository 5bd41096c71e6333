"""CSV files of the rankings of grasps, and of the grasps that a robot can reach."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from typing import Any

import polars as pl

from graspcast.errors import FormatError
from graspcast.estimates.instances import KEY_SCHEMA, InstanceKey
from graspcast.forecasting.verdict import VerdictRow
from graspcast.io.arguments import PATH, a, checked, refuse_unless, sequence
from graspcast.io.files import write_text
from graspcast.io.tables import read_csv

__all__ = ["GRASP_COLUMNS", "Rankings", "read_grasps_of", "read_reachable", "write_grasps_of"]

GRASP_COLUMNS = (*KEY_SCHEMA, "principal", "gripper", "grasp", "rank", "probability", "outcomes")
"""The columns of a file of rankings.

``rank`` is 1 for the grasp of the verdict; ``outcomes`` is on how many of the grasp's outcomes the
forecast rests.
"""

_NAMED: dict[str, Any] = {**KEY_SCHEMA, "grasp": pl.String}
_RANKED: dict[str, Any] = {
    **KEY_SCHEMA,
    "principal": pl.String,
    "gripper": pl.String,
    "grasp": pl.String,
}

Rankings = Mapping[tuple[InstanceKey, str, str], Sequence[tuple[str, float]]]
"""Instance, principal and gripper to grasps with their probabilities, the best first."""


@checked(path=PATH)
def write_grasps_of(path: str | PathLike[str], rows: Iterable[VerdictRow]) -> None:
    """Write the grasps of each verdict as CSV, the best first, atomically.

    A verdict without a forecast has no row. One by a forecaster that knows the reference grasp
    alone has one, whose ``outcomes`` is empty.
    """
    rows = list(rows) if isinstance(rows, Iterable) else rows
    refuse_unless(sequence(a(VerdictRow)), rows, "write_grasps_of", "rows")
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(GRASP_COLUMNS)
    for row in rows:
        who = (*row.key, row.principal, row.gripper)
        for rank, each in enumerate(row.verdict.grasps, 1):
            p = f"{each.probability:.6f}"
            writer.writerow([*who, each.grasp, rank, p, each.outcomes])
        if not row.verdict.grasps and row.verdict.probability is not None:
            writer.writerow([*who, row.grasp, 1, f"{row.verdict.probability:.6f}", ""])
    write_text(path, out.getvalue())


@checked(path=PATH)
def read_grasps_of(path: str | PathLike[str]) -> Rankings:
    """Read what :func:`write_grasps_of` wrote: grasps and their probabilities, the best first.

    Raises
    ------
    FormatError
        If a column is missing, or a probability is none.
    """
    frame = read_csv(path)
    if missing := [name for name in GRASP_COLUMNS if name not in frame.columns]:
        raise FormatError(
            path, f"has no column {missing[0]}; a ranking of grasps has {', '.join(GRASP_COLUMNS)}"
        )
    try:
        frame = frame.with_columns(
            pl.col(name).cast(kind)
            for name, kind in (*_RANKED.items(), ("rank", pl.Int64), ("probability", pl.Float64))
        ).sort("rank", maintain_order=True)
    except pl.exceptions.PolarsError as error:
        raise FormatError(path, f"holds something that is no number: {error}") from error
    found: dict[tuple[InstanceKey, str, str], list[tuple[str, float]]] = {}
    for row in frame.select(*_RANKED, "probability").rows():
        *key, principal, gripper, grasp, probability = row
        if probability is None or not 0 <= probability <= 1:
            raise FormatError(path, f"the probability of {grasp} is {probability}, not a share")
        of = (InstanceKey(*key), principal, gripper)
        found.setdefault(of, []).append((grasp, probability))
    return {of: tuple(ranked) for of, ranked in found.items()}


@checked(path=PATH)
def read_reachable(path: str | PathLike[str]) -> dict[InstanceKey, frozenset[str]]:
    """Read which grasps a robot can reach, one a row.

    The columns are ``dataset, scene_id, im_id, obj_id, est_id, grasp``; further ones are left out,
    and ``est_id`` may be missing where no image shows an object twice. So a file of rankings can be
    filtered and given back.

    Returns
    -------
        Instance's key to the names of the grasps. An instance without a row reaches none.

    Raises
    ------
    FormatError
        Naming the column or row: missing columns, empty fields, other than whole numbers, and rows
        that are there twice.
    """
    frame = read_csv(path)
    if "est_id" not in frame.columns:
        frame = frame.with_columns(est_id=pl.lit(0))
    if missing := [name for name in _NAMED if name not in frame.columns]:
        needed = ", ".join(_NAMED)
        raise FormatError(path, f"no column {', '.join(missing)}; needed are {needed}")
    for name, kind in _NAMED.items():
        if kind == pl.Int64 and len(frame) and not frame[name].dtype.is_integer():
            raise FormatError(path, f"{name} should be whole numbers")
        if (empty := frame[name].is_null()).any():
            row = empty.arg_true()[0] + 1
            raise FormatError(path, f"an empty field: {name}", where=f"row {row}")
    frame = frame.select(pl.col(name).cast(kind) for name, kind in _NAMED.items())
    if (twice := frame.is_duplicated()).any():
        rows = ", ".join(str(i + 1) for i in twice.arg_true()[:2])
        raise FormatError(path, f"rows {rows} are of one grasp of one instance; leave one")
    out: dict[InstanceKey, set[str]] = {}
    for *key, grasp in frame.rows():
        out.setdefault(InstanceKey(*key), set()).add(grasp)
    return {key: frozenset(names) for key, names in out.items()}
