"""Camera poses in the world, from BOP's ``scene_camera.json``."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.rotations import MAX_ROTATION_DEVIATION, checked_rotations
from graspcast.bop.scenes import Scenes
from graspcast.bop.units import metres
from graspcast.errors import FormatError, InputError
from graspcast.io.json import by_identifier, numbers, read_json, require
from graspcast.pose.transforms import invert, transform

__all__ = ["read_scene_camera_poses"]

_ROTATION, _TRANSLATION = "cam_R_w2c", "cam_t_w2c"


def read_scene_camera_poses(
    directory: str | PathLike[str], sensor: str | None = None
) -> dict[tuple[int, int], Float[ndarray, "4 4"]]:
    """Read ``cam_R_w2c`` and ``cam_t_w2c`` (mm) of all scene folders.

    Parameters
    ----------
    directory
        The directory of the scene folders (``000001`` …).
    sensor
        The camera, where there are several (``scene_camera_cam1.json``).

    Returns
    -------
    ``world_T_cam`` in metres by (scene_id, im_id). Images without these keys are left out.

    Raises
    ------
    InputError
        If no folder here has a ``scene_camera.json``.
    FormatError
        Naming file, image and key: a matrix that is no rotation, one key without the other.
    """
    file = Scenes.find(Path(directory), sensor).file("camera")
    paths = sorted(p for p in Path(directory).glob(f"*/{file}") if p.parent.name.isdecimal())
    if not paths:
        raise InputError(
            f"{directory}: no scene folder here has a {file}",
            parameters=("camera_poses",),
        )
    out: dict[tuple[int, int], ndarray] = {}
    for path in paths:
        scene_id = int(path.parent.name)
        for im_id, key, entry in by_identifier(read_json(path, dict), path, "image"):
            where = f"image {key}"
            if not isinstance(entry, dict):
                raise FormatError(path, "should be an object", where=where)
            if _ROTATION not in entry and _TRANSLATION not in entry:
                continue
            given = numbers(require(entry, _ROTATION, path, where), (3, 3), path, where)
            rotation, distance = checked_rotations(given[None])
            if distance[0] > MAX_ROTATION_DEVIATION:
                raise FormatError(
                    path,
                    f"is {distance[0]:.2g} away from a rotation",
                    where=f"{where}, {_ROTATION}",
                )
            t = numbers(require(entry, _TRANSLATION, path, where), (3,), path, where)
            if (scene_id, im_id) in out:
                raise FormatError(path, f"another folder is scene {scene_id} too; keep one")
            out[scene_id, im_id] = invert(transform(rotation[0], metres(np.asarray(t))))
    return out
