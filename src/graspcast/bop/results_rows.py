"""Rows of BOP results: parsing and checks, the same for files and for tables in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import isfinite
from os import PathLike
from typing import Any

import numpy as np
from numpy import ndarray

from graspcast.bop.rotations import MAX_ROTATION_DEVIATION, checked_rotations
from graspcast.bop.unit_checks import distance_problem
from graspcast.bop.units import metres, millimetres
from graspcast.errors import FormatError
from graspcast.io.numerals import plain
from graspcast.pose.conventions import behind_hint
from graspcast.pose.lengths import METRES
from graspcast.pose.sanity import is_placeholder, pose_problems
from graspcast.pose.transforms import transform

__all__ = ["COLUMNS", "ParsedRows", "checked_rows", "parse_rows"]

COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")


def _whole(cell: Any) -> int:
    if isinstance(cell, bool | float):
        raise ValueError
    value = int(plain(cell))
    if not 0 <= value < 2**31:
        raise ValueError
    return value


def _finite(cell: Any) -> float:
    value = float(plain(cell))
    if not isfinite(value):
        raise ValueError
    return value


def _duration(cell: Any) -> float:
    """Return seconds, or -1 for what is no duration, whatever it is: no verb depends on it."""
    try:
        value = float(cell)
    except (TypeError, ValueError, OverflowError):
        return -1.0
    return value if isfinite(value) and value >= 0 else -1.0


_SEPARATORS = str.maketrans(dict.fromkeys("[](){},;", " "))


def _floats(cell: Any) -> list[float]:
    if not isinstance(cell, str):
        return [float(part) for part in np.ravel(cell).tolist()]
    plain(cell)
    try:
        return [float(part) for part in cell.split()]
    except ValueError:
        return [float(part) for part in cell.translate(_SEPARATORS).split()]


def _numbers(count: int) -> Callable[[Any], list[float]]:
    def parse(cell: Any) -> list[float]:
        values = _floats(cell)
        if len(values) != count or not all(map(isfinite, values)):
            raise ValueError
        return values

    return parse


_PARSERS: dict[str, tuple[Callable[[Any], Any], str]] = {
    "scene_id": (_whole, "a whole number, 0 or more"),
    "im_id": (_whole, "a whole number, 0 or more"),
    "obj_id": (_whole, "a whole number, 0 or more"),
    "score": (_finite, "a finite number"),
    "R": (_numbers(9), "nine finite numbers, row by row, separated by spaces"),
    "t": (_numbers(3), "three finite numbers in millimetres, separated by spaces"),
    "time": (_duration, "seconds"),
}


def _problem(fields: Sequence[Any]) -> str | None:
    """Describe the first bad field of a row; None if all are good."""
    for name, cell in zip(COLUMNS, fields, strict=True):
        parse, expected = _PARSERS[name]
        try:
            parse(cell)
        except (TypeError, ValueError, OverflowError):
            return f"{name} is {cell!r}, but should be {expected}"
    return None


@dataclass
class ParsedRows:
    """Columns of numbers, and what to do with bad rows.

    Attributes
    ----------
    source
        The file or table, for messages.
    unit, place
        How a message names a row: ``"line"`` and the number of each row.
    columns
        ``COLUMNS`` as arrays; R is (n, 3, 3) and t (n, 3), in millimetres.
    lenient
        Whether bad rows are counted, instead of raising.
    bad
        The number of bad rows so far.
    """

    source: str | PathLike[str]
    unit: str
    place: ndarray
    columns: dict[str, ndarray]
    lenient: bool
    bad: int = 0

    def reject(self, i: int, problem: str, parameter: str = "lenient") -> None:
        """Count a bad row, or raise a FormatError that names it, and the parameter to mend it."""
        self.bad += 1
        if not self.lenient:
            where = f"{self.unit} {self.place[i]}"
            raise FormatError(self.source, problem, where=where, parameters=(parameter,))


def parse_rows(
    source: str | PathLike[str],
    unit: str,
    place: Iterable[int],
    rows: Sequence[Sequence[Any]],
    *,
    lenient: bool,
) -> ParsedRows:
    """Convert rows of cells, text or numbers, to columns of numbers.

    Parameters
    ----------
    source
        The file or table, for messages.
    unit, place
        How a message names a row: ``"line"`` and the number of each row.
    rows
        The cells of ``COLUMNS``.
    lenient
        Skip bad rows and count them, instead of raising.

    Raises
    ------
    FormatError
        Naming the first bad field, unless bad rows are skipped.
    """
    out = ParsedRows(source, unit, np.array(place, dtype=np.int64), {}, lenient)
    if lenient:
        problems = [_problem(row) for row in rows]
        good = np.array([problem is None for problem in problems], dtype=bool)
        rows = [row for row, problem in zip(rows, problems, strict=True) if problem is None]
        out.place, out.bad = out.place[good], int((~good).sum())
    cells = zip(*rows, strict=True) if rows else [()] * len(COLUMNS)
    shapes = {"R": (-1, 3, 3), "t": (-1, 3)}
    try:
        for name, column in zip(COLUMNS, cells, strict=True):
            numbers = list(map(_PARSERS[name][0], column))
            kind = np.int64 if name in COLUMNS[:3] else np.float64
            out.columns[name] = np.array(numbers, dtype=kind).reshape(shapes.get(name, (-1,)))
    except (TypeError, ValueError, OverflowError):
        # Whole columns are fast; rows are checked one by one only here.
        for i, row in enumerate(rows):
            if problem := _problem(row):
                out.reject(i, problem)
        raise  # pragma: no cover - what fails is some row's
    return out


def checked_rows(
    parsed: ParsedRows, *, placeholders: bool, length_unit: str = "mm"
) -> dict[str, Any]:
    """Check rotations, repeated rows and the unit of length; drop placeholders.

    Parameters
    ----------
    parsed
        The rows.
    placeholders
        Keep placeholders (poses with zero translation, for "nothing found").
    length_unit
        The unit of t.

    Returns
    -------
    The fields of :class:`graspcast.bop.results.Results`.

    Raises
    ------
    FormatError
        For a bad row, unless bad rows are skipped; or if the translations seem to be in
        another unit.
    """
    columns = parsed.columns
    translation_mm = columns["t"]
    if length_unit != "mm":
        translation_mm = millimetres(translation_mm * METRES[length_unit])
    is_at_centre = is_placeholder(transform(columns["R"], translation_mm))
    placeholder = is_at_centre & (not placeholders)
    keep = ~placeholder
    rotation, distance = checked_rotations(columns["R"])
    for i in np.flatnonzero((distance > MAX_ROTATION_DEVIATION) & keep).tolist():
        pose = transform(columns["R"][i : i + 1], np.array([[0.0, 0.0, 1.0]]))
        (why,) = pose_problems(pose)
        near = f"R is {distance[i]:.3g} away from the nearest rotation matrix"
        parsed.reject(i, f"{near}: the pose {why}" if why else near)
        keep[i] = False
    behind = np.flatnonzero((translation_mm[:, 2] <= 0) & keep & ~is_at_centre).tolist()
    hint = behind_hint(len(behind), int((keep & ~is_at_centre).sum()))
    for i in behind:
        z = f"t_z is {translation_mm[i, 2]:g} mm"
        # In another convention, leaving out some rows makes the others no better.
        parameter = "estimates" if hint else "lenient"
        parsed.reject(i, f"the object is behind the camera ({z}){hint}", parameter)
        keep[i] = False
    keys = np.stack([columns[name] for name in COLUMNS[:3]], axis=1)
    seen: dict[tuple[object, ...], int] = {}
    # Nearly always each image has an object once; then no row can be repeated.
    once = len(np.unique(keys, axis=0)) == len(keys)
    for i in np.flatnonzero(keep & (not once)).tolist():
        key = (*keys[i].tolist(), rotation[i].tobytes(), translation_mm[i].tobytes())
        if (first := seen.setdefault(key, i)) != i:
            where = f"{parsed.unit} {parsed.place[first]}"
            parsed.reject(i, f"repeats the instance and pose of {where}")
            keep[i] = False
    distances = metres(np.linalg.norm(translation_mm[keep & ~is_at_centre], axis=-1))
    if problem := distance_problem("t", distances, unit=length_unit):
        raise FormatError(parsed.source, problem, parameters=("length_unit",))
    dropped = {"placeholder": int(placeholder.sum()), "bad row": parsed.bad}
    return {
        **{name: keys[keep, i] for i, name in enumerate(COLUMNS[:3])},
        "score": columns["score"][keep],
        "cam_T_obj": transform(rotation[keep], metres(translation_mm[keep])),
        "time_s": columns["time"][keep],
        "line": parsed.place[keep],
        "source": str(parsed.source),
        "dropped": {reason: n for reason, n in dropped.items() if n},
    }
