"""BOP object models: sizes, symmetries and meshes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.meshes import Mesh, read_mesh
from graspcast.bop.rotations import MAX_ROTATION_DEVIATION, checked_rotations
from graspcast.bop.summary import counted
from graspcast.bop.units import metres
from graspcast.errors import FormatError, UnknownNameError
from graspcast.io.arguments import PATH, checked
from graspcast.io.json import by_identifier, numbers, read_json, require
from graspcast.pose.transforms import rotation_from_vector, transform

__all__ = ["ContinuousSymmetry", "ModelInfo", "Models", "read_models_info"]

_SYMMETRY_STEP = 0.01
"""Largest displacement between two discretised symmetries, as a fraction of the diameter."""


@dataclass(frozen=True)
class ContinuousSymmetry:
    """A continuous rotational symmetry, in the object's frame.

    Attributes
    ----------
    axis
        Direction of the axis, a unit vector.
    offset
        A point on the axis, metres.
    """

    axis: Float[ndarray, "3"]
    offset: Float[ndarray, "3"]


@dataclass(frozen=True)
class ModelInfo:
    """One object's entry of ``models_info.json``.

    Attributes
    ----------
    obj_id
        The object's id.
    diameter_m
        The largest distance between two vertices.
    lower, size
        Minimum corner and side lengths of the bounding box, metres, (3,).
    discrete
        Symmetry transforms other than the identity, (s, 4, 4).
    continuous
        Axes of rotational symmetry.
    """

    obj_id: int
    diameter_m: float
    lower: Float[ndarray, "3"]
    size: Float[ndarray, "3"]
    discrete: Float[ndarray, "s 4 4"]
    continuous: tuple[ContinuousSymmetry, ...] = ()

    @property
    def symmetric(self) -> bool:
        """Whether the object has a symmetry other than the identity."""
        return bool(len(self.discrete) or self.continuous)

    @cached_property
    def symmetries(self) -> Float[ndarray, "s 4 4"]:
        """All symmetries as transforms, (s, 4, 4), the identity first.

        Continuous symmetries are discretised so finely that no point moves by more than 1 % of the
        diameter from one to the next (Hodan et al., *BOP Challenge 2020*, Section 2.2), and
        combined with the discrete ones.
        """
        discrete = np.concatenate([np.eye(4)[None], self.discrete])
        if not self.continuous:
            return discrete
        steps = int(np.ceil(np.pi / _SYMMETRY_STEP))
        angles = np.arange(steps) * (2 * np.pi / steps)
        out = []
        for symmetry in self.continuous:
            rotation = rotation_from_vector(angles[:, None] * symmetry.axis)
            about_axis = transform(rotation, symmetry.offset - rotation @ symmetry.offset)
            # The rotation about the axis is applied first, then the discrete symmetry.
            out.append((discrete[:, None] @ about_axis[None]).reshape(-1, 4, 4))
        return np.concatenate(out)


def read_models_info(path: str | PathLike[str]) -> dict[int, ModelInfo]:
    """Read ``models_info.json``: sizes and symmetries by object id.

    Raises
    ------
    FormatError
        Naming the object and the key.
    """
    out: dict[int, ModelInfo] = {}
    for obj_id, key, entry in by_identifier(read_json(path, dict), path, "object"):
        where = f"object {key}"

        def number(name: str, entry: Any = entry, where: str = where) -> float:
            return float(numbers(require(entry, name, path, where), (), path, f"{where}, {name}"))

        diameter = number("diameter")
        if diameter <= 0:
            raise FormatError(path, "the diameter should be positive", where=where)
        out[obj_id] = ModelInfo(
            obj_id=obj_id,
            diameter_m=float(metres(np.array(diameter))),
            lower=metres(np.array([number(f"min_{a}") for a in "xyz"])),
            size=metres(np.array([number(f"size_{a}") for a in "xyz"])),
            discrete=_discrete(entry, path, where),
            continuous=_continuous(entry, path, where),
        )
    if not out:
        raise FormatError(path, "lists no object")
    return out


def _discrete(entry: Mapping[str, Any], path: str | PathLike[str], where: str) -> ndarray:
    where = f"{where}, symmetries_discrete"
    listed = entry.get("symmetries_discrete", [])
    if not isinstance(listed, list):
        raise FormatError(path, "should be a list", where=where)
    raw = np.array([numbers(v, (4, 4), path, where) for v in listed]).reshape(-1, 4, 4)
    rotation, distance = checked_rotations(raw[:, :3, :3])
    if (distance > MAX_ROTATION_DEVIATION).any():
        raise FormatError(path, "holds a matrix that is not a rotation", where=where)
    return transform(rotation, metres(raw[:, :3, 3]))


def _continuous(
    entry: Mapping[str, Any], path: str | PathLike[str], where: str
) -> tuple[ContinuousSymmetry, ...]:
    where = f"{where}, symmetries_continuous"
    listed = entry.get("symmetries_continuous", [])
    if not isinstance(listed, list):
        raise FormatError(path, "should be a list", where=where)
    out = []
    for item in listed:
        axis = numbers(require(item, "axis", path, where), (3,), path, f"{where}, axis")
        offset = numbers(require(item, "offset", path, where), (3,), path, f"{where}, offset")
        if (length := float(np.linalg.norm(axis))) == 0:
            raise FormatError(path, "the axis has no length", where=where)
        out.append(ContinuousSymmetry(axis=axis / length, offset=metres(offset)))
    return tuple(out)


class Models:
    """A directory of models: ``models_info.json`` and meshes, which are read on demand.

    Parameters
    ----------
    directory
        ``models`` or ``models_eval`` of a BOP dataset.

    Raises
    ------
    FormatError
        If ``models_info.json`` is missing or wrong.
    """

    @checked(directory=PATH)
    def __init__(self, directory: str | PathLike[str]):
        self.directory = Path(directory)
        self.info = read_models_info(self.directory / "models_info.json")
        self._meshes: dict[int, Mesh] = {}

    def __repr__(self) -> str:
        return f"Models({counted(len(self.info), 'object')}, {self.directory})"

    def __getitem__(self, obj_id: int) -> ModelInfo:
        """Return an object's entry of ``models_info.json``.

        Raises
        ------
        UnknownNameError
            For an unknown id; the message lists the known ones.
        """
        if obj_id not in self.info:
            raise UnknownNameError(
                "object",
                obj_id,
                sorted(self.info),
                hint=f"They are those of {self.directory / 'models_info.json'}",
            )
        return self.info[obj_id]

    def mesh(self, obj_id: int) -> Mesh:
        """Return the mesh of an object, in metres; it is read once."""
        self[obj_id]
        if obj_id not in self._meshes:
            self._meshes[obj_id] = read_mesh(self.directory / f"obj_{obj_id:06d}.ply")
        return self._meshes[obj_id]
