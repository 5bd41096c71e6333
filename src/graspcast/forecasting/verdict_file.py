"""The verdicts' CSV file."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.units import metres, millimetres
from graspcast.errors import FormatError
from graspcast.estimates.instances import KEY_COLUMNS, InstanceKey
from graspcast.forecasting.verdict import Verdict, VerdictRow, said_by
from graspcast.io.arguments import PATH, a, checked, refuse_unless, sequence
from graspcast.io.files import write_text
from graspcast.io.numerals import plain
from graspcast.io.reading import other_separator, read_text
from graspcast.pose.transforms import transform
from graspcast.views.next_look import NextLook

__all__ = ["COLUMNS", "read_rows", "read_verdicts", "verdict_fields", "write_verdicts"]

_NUMBERS = ("scene_id", "im_id", "obj_id", "est_id")
_NAMES = ("dataset", "principal", "gripper", "grasp")
_LOOK = (
    "look_direction",
    "look_direction_world",
    "look_axis",
    "look_axis_sd_mm",
    "look_angle_deg",
    "expected_probability",
)
_FIRST = (
    *KEY_COLUMNS,
    "principal",
    "gripper",
    "grasp",
    "probability",
    "verdict",
    "reason",
    "R",
    "t",
)
COLUMNS = (*_FIRST, "views", *_LOOK)
"""The columns of a verdicts file.

``R`` (row by row) and ``t`` (mm) are BOP's, of ``cam_T_obj``; ``views`` is from how many images.
Where the verdict is to look again: unit vectors from the object to the camera in the judged
camera's frame and in the world's, and the axis that is known worst; otherwise empty. Files of
former versions, without ``views`` and what follows, are read too.
"""


@checked(path=PATH)
def write_verdicts(path: str | PathLike[str], rows: Iterable[VerdictRow]) -> None:
    """Write verdicts as CSV, atomically; no probability is an empty field."""
    rows = list(rows) if isinstance(rows, Iterable) else rows
    refuse_unless(sequence(a(VerdictRow)), rows, "write_verdicts", "rows")
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows([COLUMNS, *verdict_fields(rows)])
    write_text(path, out.getvalue())


def verdict_fields(rows: Sequence[VerdictRow]) -> Iterator[list[Any]]:
    """Yield the fields of each row, as in :data:`COLUMNS`."""
    poses = np.stack([row.cam_T_obj for row in rows]) if rows else np.empty((0, 4, 4))
    R, t = poses[:, :3, :3].reshape(-1, 9).tolist(), millimetres(poses[:, :3, 3]).tolist()
    for i, row in enumerate(rows):
        given = row.verdict.probability
        yield [
            *row.key,
            row.principal,
            row.gripper,
            row.grasp,
            "" if given is None else f"{given:.6f}",
            row.verdict,
            row.verdict.reason,
            " ".join(map(repr, R[i])),
            " ".join(map(repr, t[i])),
            row.views,
            *_look_fields(row.verdict.look),
        ]


@checked(path=PATH)
def read_verdicts(path: str | PathLike[str]) -> list[VerdictRow]:
    """Read what :func:`write_verdicts` wrote, in the order of the file.

    Raises
    ------
    FormatError
        Naming the line; for a file of a former version, which names no instance; for two verdicts
        on the same grasp; and for a file of verdicts after each look.
    """
    lines: dict[tuple[object, ...], str] = {}
    out = []
    for found, row, where in read_rows(path):
        if row.keys() >= {"looks", "ended"}:
            raise FormatError(
                path,
                "holds the verdicts after each look; give it as such",
                parameters=("verdicts", "stages"),
            )
        trial = (found.key, found.principal, found.gripper, found.grasp)
        if trial in lines:
            raise FormatError(
                path,
                f"{lines[trial]} holds a verdict on the same grasp: {found.key}",
                where=where,
            )
        lines[trial] = where
        out.append(found)
    return out


def read_rows(
    path: str | PathLike[str], *, more: Sequence[str] = ()
) -> Iterator[tuple[VerdictRow, dict[str, str], str]]:
    """Yield each verdict of a file, its fields as text, and its line in words.

    Parameters
    ----------
    path
        A CSV.
    more
        Columns that it should have, beside those of every verdicts file.

    Raises
    ------
    FormatError
        Naming the line.
    """
    try:
        with io.StringIO(read_text(path), newline="") as stream:
            reader = csv.DictReader(stream)
            _check_columns(path, reader.fieldnames or (), more)
            for row in reader:
                where = f"line {reader.line_num}"
                yield _verdict_row(row, path, where), row, where
    except csv.Error as error:
        raise FormatError(path, f"is not a CSV file ({error})") from error


def _check_columns(path: str | PathLike[str], columns: Sequence[str], more: Sequence[str]) -> None:
    needed = (*_FIRST, *more)
    missing = [name for name in needed if name not in columns]
    if not missing:
        return
    if "verdict" in columns and "est_id" in missing:
        raise FormatError(
            path,
            "is a verdicts file of a former version, which does not say which instance a row is "
            "about; run graspcast predict again",
        )
    if problem := other_separator(",".join(columns)):
        raise FormatError(path, problem)
    what = "a file of verdicts after each look" if more else "a verdicts file"
    raise FormatError(path, f"no column {', '.join(missing)}; {what} has {', '.join(needed)}")


def _verdict_row(row: dict[str, str], path: str | PathLike[str], where: str) -> VerdictRow:
    if None in row.values() or None in row:
        raise FormatError(path, f"should have {len(row) - (None in row)} fields", where=where)
    said = row["verdict"]
    if said not in ("attempt", "look again", "abstain"):
        raise FormatError(
            path, f"the verdict is {said!r}, not attempt, look again or abstain", where=where
        )
    for name in _NAMES:
        if not row[name]:
            raise FormatError(path, f"{name} is empty", where=where)
    try:
        probability = float(plain(row["probability"])) if row["probability"] else None
    except ValueError:
        probability = float("nan")
    if probability is not None and not 0.0 <= probability <= 1.0:
        raise FormatError(
            path, f"the probability is {row['probability']}, not from 0 to 1", where=where
        )
    numbers = (_number(row[name], name, path, where) for name in _NUMBERS)
    threshold, unusual = said_by(row["reason"])
    return VerdictRow(
        key=InstanceKey(row["dataset"], *numbers),
        principal=row["principal"],
        gripper=row["gripper"],
        grasp=row["grasp"],
        verdict=Verdict(
            said == "attempt",
            probability,
            row["reason"],
            threshold,
            out_of_distribution=unusual,
            look=_look(row, path, where) if said == "look again" else None,
            grasp=row["grasp"],
        ),
        views=_number(row.get("views") or "1", "views", path, where),
        cam_T_obj=transform(
            _numbers(row["R"], 9, "R", path, where).reshape(3, 3),
            metres(_numbers(row["t"], 3, "t", path, where)),
        ),
    )


def _number(text: str, name: str, path: str | PathLike[str], where: str) -> int:
    if not (text.isascii() and text.isdecimal()) or len(text) > 10 or int(text) >= 2**31:
        raise FormatError(path, f"{name} is {text!r}, not a BOP number", where=where)
    return int(text)


def _numbers(
    text: str, count: int, name: str, path: str | PathLike[str], where: str
) -> Float[ndarray, " count"]:
    try:
        values = np.array(plain(text).split(), dtype=np.float64)
    except ValueError:
        values = np.empty(0)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise FormatError(path, f"{name} is not {count} finite numbers: {text!r}", where=where)
    return values


def _look_fields(look: NextLook | None) -> list[str]:
    if look is None:
        return [""] * len(_LOOK)
    world = look.direction_world
    expected = look.expected_probability
    return [
        _vector(look.direction),
        "" if world is None else _vector(world),
        _vector(look.axis),
        f"{float(millimetres(np.array([look.axis_sd_m]))[0]):.3f}",
        f"{np.rad2deg(look.angle_rad):.1f}",
        "" if expected is None else f"{expected:.6f}",
    ]


def _vector(vector: Float[ndarray, "3"]) -> str:
    return " ".join(f"{x:.6f}" for x in vector)


def _look(row: dict[str, str], path: str | PathLike[str], where: str) -> NextLook:
    def vector(name: str) -> Float[ndarray, "3"]:
        return _numbers(row[name], 3, name, path, where)

    def number(name: str) -> float:
        return float(_numbers(row[name], 1, name, path, where)[0])

    if missing := [name for name in _LOOK if name not in row]:
        raise FormatError(path, f"looks again, but has no {', '.join(missing)}", where=where)
    expected = row["expected_probability"]
    return NextLook(
        direction=vector("look_direction"),
        direction_world=vector("look_direction_world") if row["look_direction_world"] else None,
        axis=vector("look_axis"),
        axis_sd_m=float(metres(np.array([number("look_axis_sd_mm")]))[0]),
        angle_rad=float(np.deg2rad(number("look_angle_deg"))),
        expected_probability=number("expected_probability") if expected else None,
    )
