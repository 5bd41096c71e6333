"""Camera poses from files: BOP scene folders, or a table whose header states direction and unit.

A table has the columns ``scene_id`` and ``im_id``, and for the pose either one column or seven,
whose names begin with the direction and end with the unit of length:

- ``world_T_cam_m``: the 4x4 matrix, 16 numbers row by row, separated by spaces;
- ``world_T_cam_qw``, ``_qx``, ``_qy``, ``_qz`` and ``world_T_cam_tx_m``, ``_ty_m``, ``_tz_m``.

``world_T_cam`` maps points of the camera's frame into the world; ``cam_T_world``, BOP's w2c, is its
inverse. The unit is ``m``, ``cm``, ``mm`` or ``inch``. Nothing is guessed: a header without a
direction or a unit is refused.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.camera_poses import read_scene_camera_poses
from graspcast.errors import FormatError, InputError
from graspcast.io.arguments import PATH, checked
from graspcast.io.json import identifier
from graspcast.io.numerals import plain
from graspcast.io.reading import other_separator, read_text
from graspcast.pose.lengths import METRES
from graspcast.pose.transforms import invert, rotation_from_quaternion, transform
from graspcast.views.camera_motion import CameraMotion

__all__ = ["read_camera_motion"]

_DIRECTIONS = ("world_T_cam", "cam_T_world")
_MATRIX = re.compile(rf"({'|'.join(_DIRECTIONS)})_({'|'.join(METRES)})")
_QUATERNION = ("qw", "qx", "qy", "qz")
_UNIT_LENGTH = 0.01
_RULE = (
    "the pose is either a column world_T_cam_m (16 numbers, separated by spaces), or columns "
    "world_T_cam_qw, world_T_cam_qx, world_T_cam_qy, world_T_cam_qz, world_T_cam_tx_m, "
    "world_T_cam_ty_m, world_T_cam_tz_m; cam_T_world for the inverse, and mm, cm or inch for other "
    "units"
)
Cells = Mapping[str, str]
Parse = Callable[[Cells], Float[ndarray, "4 4"]]


@checked(path=PATH)
def read_camera_motion(path: str | PathLike[str], sensor: str | None = None) -> CameraMotion:
    """Read camera poses from a CSV table, or from the scene folders of a BOP directory.

    Parameters
    ----------
    path
        A CSV file (:mod:`graspcast.views.camera_tables` has its columns), or a directory of scene
        folders whose ``scene_camera.json`` hold ``cam_R_w2c`` and ``cam_t_w2c``.
    sensor
        The camera, where the scene folders have several (``scene_camera_cam1.json``).

    Raises
    ------
    InputError
        If there is nothing to read.
    FormatError
        Naming file, line or key: a header that states no direction or unit, a pose that is not
        rigid, an image that comes twice.
    """
    path = Path(path)
    if path.is_dir():
        poses = read_scene_camera_poses(path, sensor)
        if not poses:
            raise InputError(
                f"{path}: no image here has a camera pose (cam_R_w2c and cam_t_w2c in "
                "scene_camera.json)",
                parameters=("camera_poses",),
            )
        return CameraMotion(poses, str(path))
    return _from_table(path)


def _from_table(path: Path) -> CameraMotion:
    try:
        rows = list(csv.reader(io.StringIO(read_text(path), newline=""), strict=True))
    except csv.Error as error:
        raise FormatError(path, f"is not a CSV file ({error})") from error
    header = [name.strip() for name in rows[0]] if rows else []
    if problem := other_separator(",".join(header)):
        raise FormatError(path, problem, where="line 1", parameters=("camera_poses",))
    if missing := [name for name in ("scene_id", "im_id") if name not in header]:
        raise FormatError(
            path,
            f"no column {' and '.join(missing)}; found {', '.join(header) or 'none'}; {_RULE}",
            where="line 1",
            parameters=("camera_poses",),
        )
    if twice := {name for name in header if header.count(name) > 1}:
        raise FormatError(path, f"the column {min(twice)} comes twice", where="line 1")
    parse, inverse = _parser(path, header)
    poses: dict[tuple[int, int], ndarray] = {}
    lines: dict[tuple[int, int], int] = {}
    for line, fields in enumerate(rows[1:], start=2):
        if not any(field.strip() for field in fields):
            continue
        where = f"line {line}"
        if len(fields) != len(header):
            raise FormatError(
                path, f"has {len(fields)} fields, the header has {len(header)}", where=where
            )
        cells = dict(zip(header, (field.strip() for field in fields), strict=True))
        scene_id, im_id = (identifier(cells[c], path, where) for c in ("scene_id", "im_id"))
        if (first := lines.setdefault((scene_id, im_id), line)) != line:
            raise FormatError(
                path,
                f"image {scene_id}/{im_id} has a pose in line {first} already; keep one",
                where=where,
                parameters=("camera_poses",),
            )
        try:
            # The checks of a pose are those of CameraMotion.
            pose = CameraMotion({(scene_id, im_id): parse(cells)}).world_T_cam[scene_id, im_id]
        except (ValueError, InputError) as error:
            problem = str(error).partition(": ")[2] or str(error)
            raise FormatError(path, problem, where=where, parameters=("camera_poses",)) from error
        poses[scene_id, im_id] = invert(pose) if inverse else pose
    if not poses:
        raise FormatError(path, "holds no camera pose", parameters=("camera_poses",))
    return CameraMotion(poses, str(path))


def _parser(path: Path, header: Sequence[str]) -> tuple[Parse, bool]:
    """Return the function that reads a pose from a row, and whether it is ``cam_T_world``."""
    found: list[tuple[Parse, bool]] = []
    for name in header:
        if match := _MATRIX.fullmatch(name):
            parse = _matrix_parser(name, METRES[match[2]])
            found.append((parse, match[1] == "cam_T_world"))
    for direction in _DIRECTIONS:
        for unit, scale in METRES.items():
            q = [f"{direction}_{part}" for part in _QUATERNION]
            t = [f"{direction}_t{axis}_{unit}" for axis in "xyz"]
            if set(q) | set(t) <= set(header):
                found.append((_quaternion_parser(q, t, scale), direction == "cam_T_world"))
    if len(found) != 1:
        what = "no pose" if not found else "more than one pose"
        raise FormatError(
            path,
            f"the header states {what} with its direction and unit; found {', '.join(header)}; "
            f"{_RULE}",
            where="line 1",
            parameters=("camera_poses",),
        )
    return found[0]


def _matrix_parser(name: str, scale: float) -> Parse:
    def parse(cells: Cells) -> ndarray:
        values = _floats(cells[name].split(), name)
        if len(values) != 16:
            raise ValueError(f": {name} holds {len(values)} numbers, not 16")
        pose = np.array(values).reshape(4, 4)
        pose[:3, 3] *= scale
        return pose

    return parse


def _quaternion_parser(q: Sequence[str], t: Sequence[str], scale: float) -> Parse:
    def parse(cells: Cells) -> ndarray:
        wxyz = np.array(_floats([cells[name] for name in q], "the quaternion"))
        length = float(np.linalg.norm(wxyz))
        if not abs(length - 1) <= _UNIT_LENGTH:
            raise ValueError(f": the quaternion has the length {length:.4g}, not 1")
        position = np.array(_floats([cells[name] for name in t], "the translation")) * scale
        return transform(rotation_from_quaternion(wxyz), position)

    return parse


def _floats(texts: Sequence[str], what: str) -> list[float]:
    try:
        return [float(plain(text)) for text in texts]
    except ValueError as error:
        raise ValueError(f": {what} holds what is no number: {' '.join(texts)[:60]!r}") from error
