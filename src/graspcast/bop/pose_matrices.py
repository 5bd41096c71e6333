"""Poses as text files of 4x4 matrices, one an image, as FoundationPose writes them."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy import ndarray

from graspcast.bop.pose_rows import PoseRows, Stated
from graspcast.errors import FormatError
from graspcast.io.reading import read_text

__all__ = ["MATRICES", "matrix_rows"]

MATRICES = "FoundationPose's ob_in_cam/IMAGE.txt"

_LAST_ROW = [0.0, 0.0, 0.0, 1.0]
_ROUNDING = 1e-6


def matrix_rows(path: Path, stated: Stated) -> PoseRows | str:
    """Return the rows of a file with a 4x4 matrix, or of a directory of such; or what it misses.

    The pose is in metres, the file's name is the image's number, and there is one object in one
    scene, which have to be stated. There are no scores; they become 0.

    Parameters
    ----------
    path
        The file, or the directory with the ``.txt`` files.
    stated
        What the files do not say.

    Raises
    ------
    FormatError
        Naming the file: no matrix, no transform, a name that is no number.
    """
    files = sorted(path.glob("*.txt")) if path.is_dir() else [path]
    if not files:
        return "no .txt file is in the directory"
    if _matrix(files[0]) is None:
        return f"{'it' if files == [path] else files[0].name} is not 16 numbers"
    scene = stated.number("scene_id", None, path, None)
    number = stated.object_number("", [""], path, None)
    alone = stated if len(files) == 1 else Stated(objects=stated.objects)
    rows: list[tuple[Any, ...]] = []
    images: dict[int, Path] = {}
    for file in files:
        T = _matrix(file)
        if T is None:
            raise FormatError(file, "is not a 4x4 matrix: 16 finite numbers")
        if np.abs(T[3] - _LAST_ROW).max() > _ROUNDING:
            last = " ".join(f"{x:g}" for x in T[3])
            raise FormatError(file, f"is no transform; its last row is {last}, not 0 0 0 1")
        image = _image(file, alone)
        if (other := images.setdefault(image, file)) != file:
            raise FormatError(file, f"is of image {image}, as {other.name} is")
        rows.append((scene, image, number, 0.0, T[:3, :3].ravel(), T[:3, 3], -1.0))
    remark = "has no scores; they become 0"
    return PoseRows(rows, list(images), "image", "m", (remark,))


def _image(file: Path, stated: Stated) -> int:
    """Return the image's number, which is stated or the file's name."""
    stem = file.stem
    if stated.im_id is None and not (stem.isascii() and stem.isdecimal() and int(stem) < 2**31):
        raise FormatError(
            file,
            "its name should be the image's number, below 2,147,483,648; rename the files, or "
            "state the image of a single one",
            parameters=("im_id",),
        )
    return stated.im_id if stated.im_id is not None else int(stem)


def _matrix(path: Path) -> ndarray | None:
    try:
        values = [float(word) for word in read_text(path).split()]
    except ValueError:
        return None
    if len(values) != 16 or not all(map(isfinite, values)):
        return None
    return np.array(values).reshape(4, 4)
