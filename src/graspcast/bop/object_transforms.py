"""Transforms of objects' frames: 4x4 matrices in millimetres, as text or in JSON files."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.rotations import MAX_ROTATION_DEVIATION, checked_rotations
from graspcast.errors import FormatError
from graspcast.io.json import by_identifier, identifier, numbers, read_json
from graspcast.pose.lengths import METRES, Reference, unit_problem
from graspcast.pose.sanity import rotation_problem
from graspcast.pose.transforms import rotation_angle, transform

__all__ = ["is_file", "parse_object_transform", "read_object_transforms"]

_MOVED = Reference("a model's origin is moved by 0.5 mm to 1 m", 0.0005, 1.0)
_TURNED = np.radians(0.5)
_LAST_ROW = (0.0, 0.0, 0.0, 1.0)


def read_object_transforms(
    path: str | PathLike[str],
) -> dict[int | None, Float[ndarray, "4 4"]]:
    """Read transforms from a JSON file.

    It holds a 4x4 matrix, ``[[…], …]``, for all objects; or an object's number to its matrix,
    ``{"5": [[…], …]}``. Lengths are in millimetres, unless ``{"unit": "m", …}`` says otherwise; a
    single matrix beside a unit is called ``"transform"``.

    Returns
    -------
        Object's number, None for all, to ``obj_T_new`` in metres.

    Raises
    ------
    FormatError
        Naming file and key: no matrix, no rotation, a translation that seems to be in another unit.
    """
    content = read_json(path, object)
    if isinstance(content, list):
        return {None: parse_object_transform(content, str(path))}
    if not isinstance(content, dict):
        raise FormatError(path, "should hold a 4x4 matrix, or an object's number to its matrix")
    unit = content.get("unit", "mm")
    if not isinstance(unit, str) or unit not in METRES:
        raise FormatError(path, f"{unit!r} is none of {', '.join(METRES)}", where="unit")
    entries = {key: value for key, value in content.items() if key not in ("unit", "obj_id")}
    if set(entries) == {"transform"}:
        number = identifier(content["obj_id"], path, "obj_id") if "obj_id" in content else None
        return {number: parse_object_transform(entries["transform"], str(path), unit=unit)}
    out: dict[int | None, ndarray] = {
        number: parse_object_transform(value, str(path), f"object {key}", unit=unit)
        for number, key, value in by_identifier(entries, path, "object")
    }
    if not out:
        raise FormatError(path, "holds no transform")
    return out


def parse_object_transform(
    value: Any, source: str | PathLike[str], where: str | None = None, *, unit: str = "mm"
) -> Float[ndarray, "4 4"]:
    """Return a transform, in metres, from 16 numbers row by row: a list, or text.

    Parameters
    ----------
    value
        The numbers.
    source, where
        Where they came from, for messages.
    unit
        The unit of the translation.

    Raises
    ------
    FormatError
        If it is no transform, or the translation seems to be in another unit.
    """
    if isinstance(value, str):
        value = value.translate(str.maketrans("[](),;", "      ")).split()
    if isinstance(value, Mapping):
        raise FormatError(source, "should be a 4x4 matrix", where=where)
    matrix = numbers(value, (4, 4), source, where or "4x4 matrix")
    if not np.allclose(matrix[3], _LAST_ROW, atol=1e-6):
        last = " ".join(f"{x:g}" for x in matrix[3])
        raise FormatError(source, f"the last row is {last}, not 0 0 0 1", where=where)
    rotation, distance = checked_rotations(matrix[None, :3, :3])
    if distance[0] > MAX_ROTATION_DEVIATION:
        why = rotation_problem(matrix[:3, :3])
        raise FormatError(source, f"is no rotation: it {why}", where=where)
    moved = matrix[:3, 3] * METRES[unit]
    length = float(np.linalg.norm(moved))
    turned = bool(rotation_angle(rotation)[0] > _TURNED)
    # With a rotation, a short translation can be what is left of measuring.
    problem = unit_problem("its translation", length, _MOVED, unit=unit)
    if problem and length > 0 and not (turned and length < _MOVED.low_m):
        raise FormatError(source, problem, where=where)
    return transform(rotation[0], moved)


def is_file(text: str) -> bool:
    """Return whether a text names a file of transforms, and is no matrix itself."""
    return text.lower().endswith((".json", ".json.gz")) or Path(text).is_file()
