"""Poses in JSON files: those of SAM-6D, and the object data of MegaPose and happypose."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any

import numpy as np
from numpy import ndarray

from graspcast.bop.pose_rows import PoseRows, Stated
from graspcast.errors import FormatError
from graspcast.io.json import identifier, numbers, require
from graspcast.pose.transforms import rotation_from_quaternion

__all__ = ["MEGAPOSE", "SAM6D", "megapose_rows", "sam6d_rows"]

SAM6D = "SAM-6D's JSON"
MEGAPOSE = "object data of MegaPose or happypose"

_UNIT_QUATERNION = 0.02


def sam6d_rows(entries: Any, path: str | PathLike[str], stated: Stated) -> PoseRows | str:
    """Return the rows of SAM-6D's ``detection_pem.json``, or what it misses to be one.

    A list of detections as in the BOP Challenge, each with ``R`` (3x3) and ``t`` (mm). Scene and
    image may be 0 or -1 where SAM-6D did not know them; then they can be stated.

    Parameters
    ----------
    entries
        The content of the file.
    path
        The file, for messages.
    stated
        What the file does not say.

    Raises
    ------
    FormatError
        Naming the entry and the key.
    """
    if missed := _missed(entries, ("R", "t", "category_id")):
        return missed
    names = [str(e["category_id"]) for e in entries if isinstance(e, dict) and "category_id" in e]
    rows = []
    for i, entry in enumerate(entries):
        where = f"entry {i}"
        name = str(require(entry, "category_id", path, where))
        rows.append(
            (
                _known(entry, "scene_id", "scene_id", path, where, stated),
                _known(entry, "image_id", "im_id", path, where, stated),
                stated.object_number(name, names, path, where),
                require(entry, "score", path, where),
                numbers(require(entry, "R", path, where), (9,), path, f"{where}, R"),
                numbers(require(entry, "t", path, where), (3,), path, f"{where}, t"),
                entry.get("time", -1.0),
            )
        )
    return PoseRows(rows, range(len(rows)), "entry", "mm")


def megapose_rows(entries: Any, path: str | PathLike[str], stated: Stated) -> PoseRows | str:
    """Return the rows of an ``object_data.json``, or what it misses to be one.

    A list of objects with ``label`` and ``TWO``: the quaternion, x, y, z, w, and the position in
    metres. It is of one image, whose camera is the world. There are no scores; they become 0.

    Parameters
    ----------
    entries, path, stated
        As for :func:`sam6d_rows`.

    Raises
    ------
    FormatError
        Naming the entry and the key.
    """
    if missed := _missed(entries, ("label", "TWO")):
        return missed
    scene = stated.number("scene_id", None, path, None)
    image = stated.number("im_id", None, path, None)
    names = [str(e["label"]) for e in entries if isinstance(e, dict) and "label" in e]
    rows = []
    for i, entry in enumerate(entries):
        where = f"entry {i}"
        number = stated.object_number(
            str(require(entry, "label", path, where)), names, path, f"{where}, label"
        )
        R, t = _pose(require(entry, "TWO", path, where), path, f"{where}, TWO")
        rows.append((scene, image, number, _score(entry), R, t, -1.0))
    return PoseRows(rows, range(len(rows)), "entry", "m", ("has no scores; they become 0",))


def _missed(entries: Any, keys: Sequence[str]) -> str:
    """Say what a file misses to be a list of objects with these keys."""
    if not isinstance(entries, list) or not entries:
        return "it is no list of objects"
    found = {key for entry in entries if isinstance(entry, dict) for key in entry}
    missing = [key for key in keys if key not in found]
    return f"no {', '.join(missing)} in its entries" if missing else ""


def _known(
    entry: Any, key: str, what: str, path: str | PathLike[str], where: str, stated: Stated
) -> int:
    """Return the scene or the image of an entry; -1 is as good as none."""
    given = entry.get(key)
    none = given is None or (given == -1 and not isinstance(given, bool))
    number = None if none else identifier(given, path, f"{where}, {key}")
    return stated.number(what, number, path, where)


def _score(entry: Any) -> Any:
    return entry.get("score", 0.0)


def _pose(value: Any, path: str | PathLike[str], where: str) -> tuple[ndarray, ndarray]:
    """Parse a quaternion, x, y, z, w, and a position."""
    if not isinstance(value, list) or len(value) != 2:
        raise FormatError(path, "should be a quaternion (x, y, z, w) and a position", where=where)
    xyzw = numbers(value[0], (4,), path, f"{where}, quaternion")
    length = float(np.linalg.norm(xyzw))
    if abs(length - 1) > _UNIT_QUATERNION:
        raise FormatError(path, f"the quaternion has length {length:.3g}, not 1", where=where)
    R = rotation_from_quaternion((xyzw / length)[[3, 0, 1, 2]])
    return R.ravel(), numbers(value[1], (3,), path, f"{where}, position")
