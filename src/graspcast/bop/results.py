"""BOP results: the poses that one estimator found in the images of one dataset.

Format: https://bop.felk.cvut.cz/challenges/ (``bop19``), a CSV file with one row per detected
instance, ``scene_id,im_id,obj_id,score,R,t,time``, with R row-major and t in millimetres.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.pose_readers import pose_rows
from graspcast.bop.pose_rows import Stated
from graspcast.bop.results_rows import COLUMNS, checked_rows, parse_rows
from graspcast.bop.summary import summary
from graspcast.bop.units import millimetres
from graspcast.errors import FormatError
from graspcast.io.arguments import PATH, a, checked
from graspcast.io.files import write_text

__all__ = [
    "Results",
    "read_results",
    "score_order",
    "write_results",
]


_SHAPES: dict[str, tuple[str, tuple[int, ...]]] = {
    **dict.fromkeys(("scene_id", "im_id", "obj_id", "line"), ("iu", ())),
    **dict.fromkeys(("score", "time_s"), ("f", ())),
    "cam_T_obj": ("f", (4, 4)),
}


@dataclass(frozen=True, eq=False)
class Results:
    """Estimated poses, in the order of the file.

    Attributes
    ----------
    scene_id, im_id, obj_id
        BOP ids, (n,).
    score
        The estimator's own confidence, (n,); any finite number.
    cam_T_obj
        Poses in metres, (n, 4, 4).
    time_s
        Seconds that the estimator took for the image, -1 if unknown, (n,).
    line
        Line number in the file, 0 if there is none, (n,).
    source
        The file they came from, for messages.
    dropped
        How many rows were left out, by reason.
    remarks
        What the file lacks, in words.
    """

    scene_id: Int[ndarray, " n"]
    im_id: Int[ndarray, " n"]
    obj_id: Int[ndarray, " n"]
    score: Float[ndarray, " n"]
    cam_T_obj: Float[ndarray, "n 4 4"]
    time_s: Float[ndarray, " n"]
    line: Int[ndarray, " n"]
    source: str = "results"
    dropped: Mapping[str, int] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.obj_id) if isinstance(self.obj_id, ndarray) and self.obj_id.ndim else 0
        for name, (kinds, shape) in _SHAPES.items():
            column = getattr(self, name)
            fits = isinstance(column, ndarray) and column.shape == (n, *shape)
            if not fits or (n and column.dtype.kind not in kinds):
                raise FormatError(
                    str(self.source),
                    f"{name} should be an array of {'numbers' if 'f' in kinds else 'integers'} of "
                    f"shape {(n, *shape)}, as obj_id has {n}; Results.from_frame makes one from "
                    "lists and tables",
                )
        if n and not np.isfinite(self.score).all():
            raise FormatError(str(self.source), "a score is not a finite number")

    @classmethod
    def from_frame(
        cls,
        frame: Any,
        *,
        source: str = "table",
        lenient: bool = False,
        placeholders: bool = False,
    ) -> Results:
        """Convert a table with BOP's columns, checked as :func:`read_results` checks a file.

        Parameters
        ----------
        frame
            A pandas or polars DataFrame, or a dict of arrays or lists, with the columns

            - ``scene_id``, ``im_id``, ``obj_id``: integers;
            - ``score``: finite numbers;
            - ``R`` and ``t``: the rotation matrix, nine numbers row by row or 3x3, and the
              translation in **millimetres**, each as an array, a list or, as in a file, text; or,
              instead of both, ``cam_T_obj``: the pose as a 4x4 matrix in **metres**;
            - ``time``, optional: seconds that the image took, -1 if unknown.

            Other columns are ignored.
        source
            What the table is called in messages.
        lenient
            Skip bad rows and count them in ``dropped["bad row"]``, instead of raising.
        placeholders
            Keep placeholders (poses with zero translation, for "nothing found").

        Raises
        ------
        FormatError
            Naming the row and what is wrong with it; see :func:`read_results`.

        Examples
        --------
        >>> Results.from_frame(
        ...     {
        ...         "scene_id": [1],
        ...         "im_id": [3],
        ...         "obj_id": [5],
        ...         "score": [0.9],
        ...         "R": [[1, 0, 0, 0, 1, 0, 0, 0, 1]],
        ...         "t": [[10.0, -20.0, 900.0]],
        ...     }
        ... )
        Results(1 pose of 1 object in 1 image, table)
        """
        columns = _columns_of(frame, source)
        rows = list(zip(*columns.values(), strict=True))
        parsed = parse_rows(source, "row", range(len(rows)), rows, lenient=lenient)
        results = cls(**checked_rows(parsed, placeholders=placeholders))
        return replace(results, line=np.zeros_like(results.line))

    def __len__(self) -> int:
        return len(self.obj_id)

    def __repr__(self) -> str:
        return f"Results({summary(self, 'pose')})"

    def select(self, which: Bool[ndarray, " n"] | Int[ndarray, " m"]) -> Results:
        """Return some of the rows, by mask or by row number."""
        names = ("scene_id", "im_id", "obj_id", "score", "cam_T_obj", "time_s", "line")
        return replace(self, **{name: getattr(self, name)[which] for name in names})


def score_order(results: Results) -> Int[ndarray, " n"]:
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


@checked(path=PATH, stated=a(Stated))
def read_results(
    path: str | PathLike[str],
    *,
    lenient: bool = False,
    placeholders: bool = False,
    stated: Stated | None = None,
) -> Results:
    """Read poses: a BOP results CSV, or another file that states scene, image and object.

    The others (:mod:`graspcast.bop.pose_readers`) are SAM-6D's JSON, and, with what they do not
    say themselves, object data of MegaPose and matrices of FoundationPose.

    Rows whose translation is zero, whatever the rotation, are an estimator's placeholder for
    "nothing found"; they are dropped and counted in ``dropped["placeholder"]``.

    Parameters
    ----------
    path
        The file.
    lenient
        Skip bad rows and count them in ``dropped["bad row"]``, instead of raising.
    placeholders
        Keep placeholders (the paper's tables count them as estimates).
    stated
        What the file does not say itself, and the unit of length if it is another than the
        format's.

    Raises
    ------
    FormatError
        Naming file, line and remedy: a missing column, a field of the wrong type, a matrix further
        than 0.02 from a rotation, a repeated row, or translations that look like metres; or, for a
        file of no known form, what each reader misses.
    """
    path, stated = Path(path), stated or Stated()
    found = pose_rows(path, stated)
    places, rows, short = [], [], 0
    for place, fields in zip(found.places, found.rows, strict=True):
        if fields is not None:
            places.append(place)
            rows.append(fields)
        elif lenient:
            short += 1
        else:
            raise FormatError(
                path,
                f"does not have the {len(COLUMNS)} fields of the header",
                where=f"{found.place} {place}",
                parameters=("lenient",),
            )
    parsed = parse_rows(path, found.place, places, rows, lenient=lenient)
    parsed.bad += short
    unit = stated.unit or found.unit
    results = Results(**checked_rows(parsed, placeholders=placeholders, length_unit=unit))
    lines = results.line if found.place == "line" else np.zeros_like(results.line)
    return replace(results, line=lines, remarks=found.remarks)


@checked(path=PATH, results=a(Results))
def write_results(path: str | PathLike[str], results: Results) -> None:
    """Write a BOP results CSV; :func:`read_results` returns exactly the same poses."""
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


def _join(values: ndarray) -> str:
    return " ".join(repr(float(v)) for v in values.ravel())


def _columns_of(frame: Any, source: str) -> dict[str, list[Any]]:
    """Return the cells of ``COLUMNS`` of a table, those of ``cam_T_obj`` as R and t."""
    names = _names_of(frame, source)
    poses = "cam_T_obj" in names
    needed = [*COLUMNS[:4], *(["cam_T_obj"] if poses else ["R", "t"])]
    if missing := [name for name in needed if name not in names]:
        raise FormatError(
            source,
            f"no column {', '.join(map(repr, missing))}; found {', '.join(map(str, names))}; "
            "columns are scene_id, im_id, obj_id, score, either R and t (mm) or cam_T_obj (m), "
            "and time if it is known",
        )
    cells = {name: _cells(frame[name], name, source) for name in [*needed, *({"time"} & {*names})]}
    cells.setdefault("time", [-1.0] * len(cells["score"]))
    if len({len(column) for column in cells.values()}) > 1:
        lengths = ", ".join(f"{name} {len(column)}" for name, column in cells.items())
        raise FormatError(source, f"the columns have different lengths: {lengths}")
    if poses:
        try:
            matrices = np.array([np.stack(cell) for cell in cells.pop("cam_T_obj")], np.float64)
            matrices = matrices.reshape(-1, 4, 4)
        except Exception as error:  # tensors of other libraries raise what they like
            raise FormatError(source, "cam_T_obj should be 4x4 matrices of numbers") from error
        if not (matrices[:, 3] == [0, 0, 0, 1]).all():
            raise FormatError(source, "the last row of every cam_T_obj should be 0, 0, 0, 1")
        cells["R"] = matrices[:, :3, :3].tolist()
        cells["t"] = millimetres(matrices[:, :3, 3]).tolist()
    return {name: cells[name] for name in COLUMNS}


def _names_of(frame: Any, source: str) -> list[Any]:
    columns = getattr(frame, "columns", frame)
    table = isinstance(frame, Mapping) or (columns is not frame and hasattr(frame, "__getitem__"))
    try:
        names = list(columns)
    except Exception:
        table = False
    if not table:
        raise FormatError(
            source,
            f"should be a DataFrame, or a dict of columns, not {type(frame).__name__}",
        )
    return names


def _cells(column: Any, name: str, source: str) -> list[Any]:
    to_list: Callable[[], Any] | None
    to_list = getattr(column, "to_list", None) or getattr(column, "tolist", None)
    try:
        cells = to_list() if to_list else list(column)
    except Exception:
        cells = None
    if not isinstance(cells, list) or isinstance(column, str | bytes):
        raise FormatError(source, f"the column {name} should be an array or a list")
    return cells
