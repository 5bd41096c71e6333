"""Files of grasp poses that other programs write: GraspGen's JSON, Isaac grasps, plain tables."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import FormatError, InputError
from graspcast.io.arguments import PATH, checked
from graspcast.io.json import numbers, read_json, require
from graspcast.io.numerals import plain
from graspcast.io.reading import read_text
from graspcast.io.wording import counted
from graspcast.pose.transforms import project_to_rotation, rotation_from_quaternion, transform

__all__ = ["GraspPoses", "read_grasp_poses"]

_RIGID = 1e-3


@dataclass(frozen=True, eq=False)
class GraspPoses:
    """Poses of a gripper on an object, as a file has them.

    Attributes
    ----------
    obj_T_hand
        The poses, in the file's unit, (n, 4, 4).
    names
        Name or number of each in the file.
    form
        ``"GraspGen"``, ``"Isaac grasp"`` or ``"table"``.
    notes
        What was left out or stands in the file besides.
    """

    obj_T_hand: Float[ndarray, "n 4 4"]
    names: tuple[str, ...]
    form: str
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.names)


@checked(path=PATH)
def read_grasp_poses(path: str | PathLike[str]) -> GraspPoses:
    """Read grasp poses, without converting anything.

    A ``.json`` file is one of GraspGen's (``grasps.transforms``, of which those with a false
    ``grasps.object_in_gripper`` are left out), an Isaac grasp file in JSON (``grasps.NAME`` with
    ``position`` and ``orientation``), or a list of 4x4 matrices. A ``.csv`` file has 16 numbers a
    row, row by row of the matrix; a line of names at its start is skipped.

    Raises
    ------
    FormatError
        If a row is no rigid transform, with its place in the file.
    InputError
        If the file is of another kind, or holds no grasp.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind == ".csv":
        found = _of_csv(path)
    elif kind == ".json":
        found = _of_json(path)
    else:
        other = "write a YAML file as JSON (yq -o json); " if kind in (".yaml", ".yml") else ""
        raise InputError(
            f"{path}: grasp poses are read from .json and .csv files; {other}GraspGen's JSON, a "
            "list of 4x4 matrices or a CSV of 16 numbers a row will do",
            parameters=("poses",),
        )
    if not len(found):
        left = f" ({'; '.join(found.notes)})" if found.notes else ""
        raise InputError(f"{path}: holds no grasp{left}", parameters=("poses",))
    return found


def _of_csv(path: Path) -> GraspPoses:
    matrices, names = [], []
    for line, row in enumerate(csv.reader(read_text(path).splitlines()), start=1):
        if not row or (line == 1 and len(row) > 1 and not any(map(_is_number, row))):
            continue
        matrices.append(_matrix(row, path, f"line {line}"))
        names.append(f"line {line}")
    return GraspPoses(_rigid(matrices, names, path), tuple(names), "table")


def _of_json(path: Path) -> GraspPoses:
    content = read_json(path, object)
    if isinstance(content, Mapping):
        grasps = require(content, "grasps", path, "the file")
        if isinstance(grasps, Mapping) and grasps.keys() & {"transforms", "object_in_gripper"}:
            return _of_graspgen(content, grasps, path)
        if isinstance(grasps, Mapping):
            return _of_isaac(grasps, path)
        content = grasps
    if not isinstance(content, list):
        raise FormatError(path, "should hold a list of 4x4 matrices, or an object with grasps")
    names = [f"grasp {k}" for k in range(len(content))]
    if _shape(content) == (4, 4):
        raise FormatError(path, "holds one 4x4 matrix; put it into a list of matrices")
    matrices = [_matrix(m, path, n) for m, n in zip(content, names, strict=True)]
    return GraspPoses(_rigid(matrices, names, path), tuple(names), "table")


def _of_graspgen(content: Mapping[str, Any], grasps: Mapping[str, Any], path: Path) -> GraspPoses:
    listed = require(grasps, "transforms", path, "grasps")
    held = grasps.get("object_in_gripper")
    for key, value in (("transforms", listed), ("object_in_gripper", held)):
        if value is not None and not isinstance(value, list):
            raise FormatError(path, "should be a list", where=f"grasps.{key}")
    if held is not None and len(held) != len(listed):
        raise FormatError(
            path, f"lists {len(listed)} transforms, but {len(held)} values of object_in_gripper"
        )
    for k, value in enumerate(held or ()):
        if value not in (True, False):  # 1 and 0 too
            raise FormatError(
                path, f"{value!r} is neither true nor false", where=f"grasps.object_in_gripper[{k}]"
            )
    rows = [k for k in range(len(listed)) if held is None or held[k]]
    notes = []
    if len(rows) < len(listed):
        failed = len(listed) - len(rows)
        notes.append(f"left out {counted(failed, 'failed grasp')} (object_in_gripper is false)")
    described = content.get("object", {})
    scale = described.get("scale", 1.0) if isinstance(described, Mapping) else 1.0
    if scale != 1.0:
        notes.append(f"the grasps are of a mesh scaled by {scale}; is the object's so too?")
    names = [f"grasp {k}" for k in rows]
    matrices = [_matrix(listed[k], path, f"grasps.transforms[{k}]") for k in rows]
    return GraspPoses(_rigid(matrices, names, path), tuple(names), "GraspGen", tuple(notes))


def _of_isaac(grasps: Mapping[str, Any], path: Path) -> GraspPoses:
    matrices = []
    for name, entry in grasps.items():
        where = f"grasps.{name}"
        position = require(entry, "position", path, where)
        position = numbers(position, (3,), path, f"{where}.position")
        turn = require(entry, "orientation", path, where)
        w = numbers(require(turn, "w", path, where), (1,), path, f"{where}.orientation.w")
        xyz = numbers(require(turn, "xyz", path, where), (3,), path, f"{where}.orientation.xyz")
        q = np.concatenate([w, xyz])
        if abs(np.linalg.norm(q) - 1) > _RIGID:
            raise FormatError(path, "the orientation has not length 1", where=where)
        matrices.append(transform(rotation_from_quaternion(q), position))
    names = list(grasps)
    return GraspPoses(_rigid(matrices, names, path), tuple(names), "Isaac grasp")


def _matrix(value: Any, path: Path, where: str) -> Float[ndarray, "4 4"]:
    if np.prod(_shape(value)) == 12:
        raise FormatError(
            path, "has 12 numbers; a 4x4 matrix is needed, with the last row 0 0 0 1", where=where
        )
    return numbers(value, (4, 4), path, where)


def _shape(value: Any) -> tuple[int, ...]:
    """Return the shape of numbers in nested lists; (0,) of anything else."""
    try:
        return np.array(value, dtype=np.float64).shape
    except (TypeError, ValueError, OverflowError):
        return (0,)


def _rigid(
    matrices: Sequence[Float[ndarray, "4 4"]], names: Sequence[str], path: Path
) -> Float[ndarray, "n 4 4"]:
    """Return the matrices with exact rotations; raise if one is no rigid transform."""
    out = np.array(matrices).reshape(-1, 4, 4)
    for matrix, name in zip(out, names, strict=True):
        if not np.allclose(matrix[3], [0, 0, 0, 1], atol=_RIGID):
            turned = np.allclose(matrix[:, 3], [0, 0, 0, 1], atol=_RIGID)
            raise FormatError(
                path,
                "the last row of the matrix is not 0 0 0 1"
                + ("; it is transposed: give rows one after another" if turned else ""),
                where=name,
            )
        rotation = matrix[:3, :3]
        off = np.abs(rotation @ rotation.T - np.eye(3)).max()
        if off > _RIGID or np.linalg.det(rotation) < 0:
            raise FormatError(path, "is no rotation and translation", where=name)
    return transform(project_to_rotation(out[:, :3, :3]), out[:, :3, 3])


def _is_number(text: str) -> bool:
    try:
        float(plain(text))
    except ValueError:
        return False
    return True
