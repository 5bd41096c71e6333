"""BOP results CSV: the poses that one estimator saw in the images of one dataset.

Format: https://bop.felk.cvut.cz/challenges/ (``bop19``), one row per detected instance,
``scene_id,im_id,obj_id,score,R,t,time`` with R row-major and t in millimetres.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import isfinite
from operator import itemgetter
from os import PathLike
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.units import metres, millimetres
from graspcast.errors import FormatError
from graspcast.io.files import write_text
from graspcast.pose.transforms import is_identity, project_to_rotation, transform

__all__ = [
    "Results",
    "checked_rotations",
    "dataset_of",
    "read_results",
    "score_order",
    "write_results",
]

COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
MAX_ROTATION_DEVIATION = 0.02
"""Frobenius distance to the nearest rotation from which a matrix is refused."""
_ROUNDING = 1e-5
"""Below this distance a matrix is a rotation written in single precision, and is left alone."""
_MIN_MEDIAN_DISTANCE_MM = 10.0


@dataclass(frozen=True)
class Results:
    """Estimated poses, in the order of the file.

    Attributes
    ----------
    scene_id, im_id, obj_id
        BOP numbers, (n,).
    score
        The estimator's own confidence, (n,); anything finite.
    cam_T_obj
        Poses in metres, (n, 4, 4).
    time_s
        Seconds that the image took, -1 if unknown, (n,).
    line
        Line number in the file, 0 if there is none, (n,).
    source
        The file they came from, for messages.
    dropped
        How many rows were left out, by reason.
    """

    scene_id: Int[ndarray, "n"]
    im_id: Int[ndarray, "n"]
    obj_id: Int[ndarray, "n"]
    score: Float[ndarray, "n"]
    cam_T_obj: Float[ndarray, "n 4 4"]
    time_s: Float[ndarray, "n"]
    line: Int[ndarray, "n"]
    source: str = "results"
    dropped: Mapping[str, int] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.obj_id)

    def select(self, which: Bool[ndarray, "n"] | Int[ndarray, "m"]) -> Results:
        """Some of the rows, by mask or by number."""
        names = ("scene_id", "im_id", "obj_id", "score", "cam_T_obj", "time_s", "line")
        return replace(self, **{name: getattr(self, name)[which] for name in names})


def score_order(results: Results) -> Int[ndarray, "n"]:
    """Sort detections by decreasing score, ties by pose.

    Rows with equal scores are sorted by the pose: smaller t_z first (the nearer object), then t_x,
    t_y, then the nine entries of the rotation matrix, row by row. So the order of the rows in the
    file does not matter, except between rows with the same score and the same pose.

    Parameters
    ----------
    results
        The detections.

    Returns
    -------
    Row numbers, the highest score first, (n,).
    """
    x, y, z = results.cam_T_obj[:, :3, 3].T
    rotation = results.cam_T_obj[:, :3, :3].reshape(-1, 9)
    # The last key of lexsort is the first to be compared.
    return np.lexsort((*rotation.T[::-1], y, x, z, -results.score))


def dataset_of(path: str | PathLike[str]) -> str | None:
    """The dataset that a results file's name states (``METHOD_DATASET-SPLIT.csv``), if any."""
    match = re.fullmatch(r".+_([A-Za-z0-9]+)-[A-Za-z0-9_]+", Path(path).stem)
    return match.group(1) if match else None


def _whole(text: str) -> int:
    value = int(text)
    if not 0 <= value < 2**31:
        raise ValueError
    return value


def _finite(text: str) -> float:
    value = float(text)
    if not isfinite(value):
        raise ValueError
    return value


def _duration(text: str) -> float:
    value = _finite(text)
    if value < 0 and value != -1:
        raise ValueError
    return value


def _numbers(count: int) -> Callable[[str], list[float]]:
    def parse(text: str) -> list[float]:
        values = [float(part) for part in text.split()]
        if len(values) != count or not all(map(isfinite, values)):
            raise ValueError
        return values

    return parse


_PARSERS: dict[str, tuple[Callable[[str], object], str]] = {
    "scene_id": (_whole, "a whole number, 0 or more"),
    "im_id": (_whole, "a whole number, 0 or more"),
    "obj_id": (_whole, "a whole number, 0 or more"),
    "score": (_finite, "a finite number"),
    "R": (_numbers(9), "nine finite numbers, row by row, separated by spaces"),
    "t": (_numbers(3), "three finite numbers in millimetres, separated by spaces"),
    "time": (_duration, "seconds, or -1 if unknown"),
}


def _rows(path: Path) -> Iterator[tuple[int, tuple[str, ...] | None]]:
    """Line number and the fields of ``COLUMNS``; None for a row with too few or too many fields."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.reader(stream, strict=True)
            header = [name.strip() for name in next(reader, [])]
            missing = [name for name in COLUMNS if name not in header]
            if missing:
                found = ", ".join(header) or "none"
                raise FormatError(
                    path,
                    f"no column {', '.join(map(repr, missing))}; found {found}; the first line of "
                    f"a results file is {','.join(COLUMNS)}",
                    where="line 1",
                )
            wanted = itemgetter(*(header.index(name) for name in COLUMNS))
            for fields in reader:
                if fields:
                    yield reader.line_num, wanted(fields) if len(fields) == len(header) else None
    except OSError as error:
        raise FormatError(path, f"cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise FormatError(path, "is not UTF-8 text; is it a CSV file?") from error
    except csv.Error as error:
        raise FormatError(path, f"is not a CSV file ({error})") from error


def _problem(fields: tuple[str, ...]) -> str | None:
    """What is wrong with the first bad field of a row, if any."""
    for name, text in zip(COLUMNS, fields, strict=True):
        parse, expected = _PARSERS[name]
        try:
            parse(text)
        except ValueError:
            return f"{name} is {text!r}, but should be {expected}"
    return None


def checked_rotations(
    matrices: Float[ndarray, "n 3 3"],
) -> tuple[Float[ndarray, "n 3 3"], Float[ndarray, "n"]]:
    """Matrices with slightly bad ones replaced by the nearest rotation, and the distances.

    The distance is Frobenius; a distance up to 1e-5 is rounding and changes nothing; the caller
    refuses those over :data:`MAX_ROTATION_DEVIATION`.
    """
    nearest = project_to_rotation(matrices)
    distance = np.linalg.norm(matrices - nearest, axis=(-2, -1))
    return np.where(distance[:, None, None] > _ROUNDING, nearest, matrices), distance


def read_results(
    path: str | PathLike[str], *, lenient: bool = False, placeholders: bool = False
) -> Results:
    """Read a BOP results CSV.

    Rows whose pose is the identity with zero translation are an estimator's placeholder for
    'nothing found'; they are dropped and counted in ``dropped["placeholder"]``.

    Parameters
    ----------
    path
        The file.
    lenient
        Skip bad rows and count them in ``dropped["bad row"]``, instead of raising.
    placeholders
        Keep placeholders (the paper's tables count them as estimates).

    Raises
    ------
    FormatError
        Naming file, line and remedy: a missing column, a field that is not what it should be, a
        matrix further than 0.02 from a rotation, the same row twice, or translations that look like
        metres.
    """
    path = Path(path)
    bad = 0
    lines: list[int] = []
    rows: list[tuple[str, ...]] = []

    def reject(line: int, problem: str) -> None:
        nonlocal bad
        bad += 1
        if not lenient:
            raise FormatError(path, f"{problem}; --lenient skips such rows", where=f"line {line}")

    for line, fields in _rows(path):
        if fields is None:
            reject(line, f"has not the {len(COLUMNS)} fields of the header")
        elif problem := _problem(fields) if lenient else None:
            reject(line, problem)
        else:
            lines.append(line)
            rows.append(fields)
    try:
        texts = zip(*rows, strict=True) if rows else [()] * len(COLUMNS)
        columns = {
            name: list(map(_PARSERS[name][0], column))
            for name, column in zip(COLUMNS, texts, strict=True)
        }
    except ValueError:  # whole columns are fast; only a bad file is gone through row by row
        for line, fields in zip(lines, rows, strict=True):
            if problem := _problem(fields):
                reject(line, problem)
        raise
    count = len(lines)
    rotation = np.array(columns["R"], dtype=np.float64).reshape(count, 3, 3)
    translation_mm = np.array(columns["t"], dtype=np.float64).reshape(count, 3)
    placeholder = is_identity(transform(rotation, translation_mm)) & (not placeholders)
    keep = ~placeholder
    rotation, distance = checked_rotations(rotation)
    for i in np.flatnonzero((distance > MAX_ROTATION_DEVIATION) & keep):
        reject(lines[i], f"R is {distance[i]:.3g} away from the nearest rotation matrix")
        keep[i] = False
    keys = np.array([columns[k] for k in ("scene_id", "im_id", "obj_id")], dtype=np.int64).T
    seen: dict[tuple[object, ...], int] = {}
    once = len(np.unique(keys, axis=0)) == count  # as nearly always: then no row can be repeated
    for i in np.flatnonzero(keep & (not once)):
        key = (*keys[i].tolist(), rotation[i].tobytes(), translation_mm[i].tobytes())
        if (first := seen.setdefault(key, lines[i])) != lines[i]:
            reject(lines[i], f"repeats the instance and pose of line {first}")
            keep[i] = False
    if keep.any():
        median = float(np.median(np.linalg.norm(translation_mm[keep], axis=-1)))
        if median < _MIN_MEDIAN_DISTANCE_MM:
            raise FormatError(
                path,
                f"the median distance is {median:.3g} mm; t seems to be in metres, but BOP results "
                "are in millimetres: multiply t by 1000",
            )
    dropped = {"placeholder": int(placeholder.sum()), "bad row": bad}
    keys = keys[keep].reshape(-1, 3)
    return Results(
        scene_id=keys[:, 0],
        im_id=keys[:, 1],
        obj_id=keys[:, 2],
        score=np.array(columns["score"], dtype=np.float64)[keep],
        cam_T_obj=transform(rotation[keep], metres(translation_mm[keep])),
        time_s=np.array(columns["time"], dtype=np.float64)[keep],
        line=np.array(lines, dtype=np.int64)[keep],
        source=str(path),
        dropped={reason: n for reason, n in dropped.items() if n},
    )


def _join(values: ndarray) -> str:
    return " ".join(repr(float(v)) for v in values.ravel())


def write_results(path: str | PathLike[str], results: Results) -> None:
    """Write a BOP results CSV; :func:`read_results` gives the very same poses back."""
    translation_mm = millimetres(results.cam_T_obj[:, :3, 3])
    lines = [",".join(COLUMNS)]
    for i in range(len(results)):
        time_s = float(results.time_s[i])
        lines.append(
            f"{results.scene_id[i]},{results.im_id[i]},{results.obj_id[i]},"
            f"{float(results.score[i])!r},{_join(results.cam_T_obj[i, :3, :3])},"
            f"{_join(translation_mm[i])},{'-1' if time_s == -1 else repr(time_s)}"
        )
    write_text(path, "\n".join(lines) + "\n")
