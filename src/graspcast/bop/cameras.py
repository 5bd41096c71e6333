"""Cameras of a BOP dataset: the intrinsics of the dataset, of a scene's images, and their checks.

A dataset's ``camera.json`` states intrinsics and image size; datasets with several cameras have
``camera_TYPE.json``, and ``scene_camera.json`` states the intrinsics of each image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.unit_checks import camera_problem
from graspcast.bop.units import metres
from graspcast.errors import FormatError, InputError
from graspcast.io.json import identifier, numbers, read_json, require

__all__ = [
    "Camera",
    "camera_file",
    "image_size",
    "other_size_problem",
    "read_camera",
    "scene_camera",
]

_SAME = 1e-3


@dataclass(frozen=True)
class Camera:
    """The camera of an image.

    Attributes
    ----------
    K
        Intrinsics in pixels, (3, 3).
    depth_scale_m
        Metres per unit of the depth image.
    """

    K: Float[ndarray, "3 3"]
    depth_scale_m: float


def _camera_files(root: Path, types: Sequence[str]) -> list[Path]:
    """Return the files that may state a dataset's camera: of a type, else for all, else any."""
    for name in (*(f"camera_{of}.json" for of in types if of), "camera.json"):
        if (root / name).exists():
            return [root / name]
    return sorted(root.glob("camera_*.json"))


def camera_file(root: Path, types: Sequence[str] = ()) -> Path:
    """Return the file of a dataset's camera.

    Parameters
    ----------
    root
        The dataset's directory.
    types
        The camera's names, of which one may be in the name of its file: ``camera_TYPE.json``.

    Raises
    ------
    InputError
        If it may be one of several.
    """
    found = _camera_files(root, types)
    if len(found) > 1:
        raise InputError(
            f"{root}: which camera, {' or '.join(path.name for path in found)}? The image has no "
            "intrinsics of its own in scene_camera.json; copy the right file to camera.json"
        )
    return found[0] if found else root / "camera.json"


def _read_size(path: Path) -> tuple[int, int] | None:
    """Return width and height in pixels that a camera's file states, None if it states none."""
    entry = read_json(path, dict)
    if "width" not in entry or "height" not in entry:
        return None
    return identifier(entry["width"], path, "width"), identifier(entry["height"], path, "height")


def read_camera(path: Path) -> Camera:
    """Read ``camera.json`` or ``camera_TYPE.json``.

    Raises
    ------
    FormatError
        Naming the key, or what contradicts the image size.
    """
    entry = read_json(path, dict)
    fx, fy, cx, cy = (
        float(numbers(require(entry, key, path, key), (), path, key))
        for key in ("fx", "fy", "cx", "cy")
    )
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    if problem := camera_problem(K, _read_size(path)):
        raise FormatError(path, problem)
    scale = numbers(entry.get("depth_scale", 1.0), (), path, "depth_scale")
    return Camera(K=K, depth_scale_m=float(metres(scale)))


def image_size(root: Path, types: Sequence[str] = ()) -> tuple[int, int] | None:
    """Return the size that a dataset's camera files state, None if there are several or none."""
    sizes = {_read_size(path) for path in _camera_files(root, types)}
    return sizes.pop() if len(sizes) == 1 else None


def scene_camera(
    entry: Any, path: Path, where: str, image_size: tuple[int, int] | None = None
) -> Camera:
    """Read an image's entry of ``scene_camera.json``.

    Parameters
    ----------
    entry, path, where
        The entry, the file and the image, for messages.
    image_size
        The image's width and height, which the intrinsics must suit, if they are known.

    Raises
    ------
    FormatError
        Naming the image and the key.
    """
    K = numbers(require(entry, "cam_K", path, where), (3, 3), path, f"{where}, cam_K")
    if problem := camera_problem(K, image_size):
        raise FormatError(path, problem, where=f"{where}, cam_K")
    scale = numbers(entry.get("depth_scale", 1.0), (), path, f"{where}, depth_scale")
    return Camera(K=K, depth_scale_m=float(metres(scale)))


def other_size_problem(root: Path, own: Float[ndarray, "3 3"] | None, size: tuple[int, int]) -> str:
    """Say why an image may not have another size than the dataset's, or nothing.

    Parameters
    ----------
    root
        The dataset's directory.
    own
        The image's own intrinsics, if ``scene_camera.json`` has them.
    size
        The image's width and height.
    """
    if own is None:
        return "and scene_camera.json has no cam_K of its own for it"
    for path in (root / "camera.json", *sorted(root.glob("camera_*.json"))):
        if path.exists() and np.allclose(read_camera(path).K, own, rtol=_SAME, atol=0.0):
            return f"and its cam_K in scene_camera.json is that of {path.name}"
    width, height = size
    if not (0 < own[0, 2] < width and 0 < own[1, 2] < height):
        return (
            f"and the principal point of its cam_K in scene_camera.json, {own[0, 2]:.4g}, "
            f"{own[1, 2]:.4g}, is not in it"
        )
    return ""
