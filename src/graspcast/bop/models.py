"""BOP object models: sizes, symmetries and meshes."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.meshes import Mesh, read_mesh
from graspcast.bop.rotations import MAX_ROTATION_DEVIATION, checked_rotations
from graspcast.bop.unit_checks import (
    diameter_problem,
    distance_problem,
    mesh_problem,
    models_problem,
    symmetry_problem,
)
from graspcast.bop.units import metres
from graspcast.errors import FormatError, UnknownNameError
from graspcast.io.arguments import PATH, checked
from graspcast.io.cached import cached_property
from graspcast.io.json import by_identifier, numbers, read_json, require
from graspcast.io.wording import counted
from graspcast.pose.lengths import between
from graspcast.pose.sanity import is_placeholder
from graspcast.pose.transforms import rotation_from_vector, transform

__all__ = ["ContinuousSymmetry", "ModelInfo", "Models", "mesh_name", "read_models_info"]

_log = logging.getLogger(__name__)

_BOUNDS = tuple(f"{what}_{axis}" for what in ("min", "size") for axis in "xyz")

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

    Bounds that it lacks are those of the mesh beside it; a symmetry's axis without an offset goes
    through the origin.

    Raises
    ------
    FormatError
        Naming the object and the key; also if its lengths contradict each other, or what a hand
        grasps, as they do in another unit than millimetres.
    """
    out: dict[int, ModelInfo] = {}
    for obj_id, key, entry in by_identifier(read_json(path, dict), path, "object"):
        where = f"object {key}"

        def number(name: str, entry: Any = entry, where: str = where) -> float:
            return float(numbers(require(entry, name, path, where), (), path, f"{where}, {name}"))

        diameter = number("diameter")
        if diameter <= 0:
            raise FormatError(path, "the diameter should be positive", where=where)
        if any(key in entry for key in _BOUNDS):
            bounds = metres(np.array([number(key) for key in _BOUNDS]).reshape(2, 3))
        else:
            bounds = _bounds_of_mesh(Path(path), obj_id, where)
        out[obj_id] = ModelInfo(
            obj_id=obj_id,
            diameter_m=float(metres(np.array(diameter))),
            lower=bounds[0],
            size=bounds[1],
            discrete=_discrete(entry, path, where),
            continuous=_continuous(entry, path, where),
        )
        _check_lengths(out[obj_id], path, where)
    if not out:
        raise FormatError(path, "lists no object")
    if problem := models_problem(np.array([info.diameter_m for info in out.values()])):
        raise FormatError(path, problem)
    return out


def _bounds_of_mesh(path: Path, obj_id: int, where: str) -> Float[ndarray, "2 3"]:
    """Return minimum corner and side lengths of the mesh beside ``models_info.json``."""
    mesh = path.with_name(mesh_name(obj_id))
    if not mesh.is_file():
        raise FormatError(
            path,
            f"no {_BOUNDS[0]}, …, {_BOUNDS[-1]}, and no {mesh.name} beside it to take them from",
            where=where,
        )
    vertices = read_mesh(mesh).vertices
    return np.stack([vertices.min(axis=0), np.ptp(vertices, axis=0)])


def mesh_name(obj_id: int) -> str:
    """Return the name of an object's mesh file: ``obj_000005.ply``."""
    return f"obj_{obj_id:06d}.ply"


def _check_lengths(info: ModelInfo, path: str | PathLike[str], where: str) -> None:
    """Raise if diameter, bounds and symmetries of an object contradict each other."""
    if problem := diameter_problem(info.diameter_m, info.size):
        raise FormatError(path, problem, where=where)
    centre = info.lower + info.size / 2
    for pose in info.discrete:
        if problem := symmetry_problem(pose[:3, :3], pose[:3, 3], centre, info.diameter_m):
            raise FormatError(path, problem, where=f"{where}, symmetries_discrete")
    for symmetry in info.continuous:
        # Half a turn about the axis; the offset's part along the axis has no effect.
        half_turn = 2 * np.outer(symmetry.axis, symmetry.axis) - np.eye(3)
        moved = symmetry.offset - half_turn @ symmetry.offset
        if problem := symmetry_problem(half_turn, moved, centre, info.diameter_m):
            raise FormatError(path, problem, where=f"{where}, symmetries_continuous, offset")


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
        offset = numbers(item.get("offset", [0.0] * 3), (3,), path, f"{where}, offset")
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
        self._checked: set[int] = set()

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
        """Return the mesh of an object, in metres; it is read once.

        Raises
        ------
        FormatError
            If the file cannot be read, or contradicts ``models_info.json``.
        """
        self[obj_id]
        if obj_id not in self._meshes:
            self._meshes[obj_id] = self._check(obj_id, read_mesh(self._path(obj_id)))
        return self._meshes[obj_id]

    def check_a_mesh(self) -> None:
        """Compare ``models_info.json`` with the smallest mesh file, unless one was read already.

        Raises
        ------
        FormatError
            If they contradict each other. A mesh that cannot be read is left to whoever needs it.
        """
        present = [obj_id for obj_id in self.info if self._path(obj_id).is_file()]
        if self._checked or not present:
            return
        smallest = min(present, key=lambda obj_id: self._path(obj_id).stat().st_size)
        try:
            mesh = read_mesh(self._path(smallest))
        except FormatError:
            return
        self._check(smallest, mesh)

    def check_distances(
        self, source: str, obj_id: Int[ndarray, " n"], cam_T_obj: Float[ndarray, "n 4 4"]
    ) -> None:
        """Raise unless estimates are as far away as objects of these diameters can be seen.

        Parameters
        ----------
        source
            Where the estimates came from, for messages.
        obj_id, cam_T_obj
            Objects and their poses; placeholders and objects without a model are left out.

        Raises
        ------
        FormatError
            Naming both medians and the unit that would fit.
        """
        there = ~is_placeholder(cam_T_obj)
        sizes = {number: info.diameter_m for number, info in self.info.items()}
        diameters = np.array([sizes.get(number, np.nan) for number in obj_id[there].tolist()])
        distances = np.linalg.norm(cam_T_obj[there, :3, 3], axis=1)
        if problem := distance_problem("t", distances, diameters):
            raise FormatError(source, problem, parameters=("estimates", "bop"))

    @property
    def lengths(self) -> str:
        """The sizes in words: ``"102 to 123 mm across (models_info.json and 2 meshes agree)"``."""
        sizes = [info.diameter_m for info in self.info.values()]
        said = f"{between(min(sizes), max(sizes))} across"
        if not self._checked:
            return f"{said} (by models_info.json)"
        verb = "agrees" if len(self._checked) == 1 else "agree"
        count = "1 mesh" if len(self._checked) == 1 else f"{len(self._checked)} meshes"
        return f"{said} (models_info.json; {count} {verb})"

    def _path(self, obj_id: int) -> Path:
        return self.directory / mesh_name(obj_id)

    def _check(self, obj_id: int, mesh: Mesh) -> Mesh:
        """Return the mesh, without vertices of no face if it agrees only so; raise if it does not.

        Scans that were cut out of a larger one may have such vertices far away.
        """
        info = self.info[obj_id]
        if problem := mesh_problem(info.diameter_m, info.lower, mesh.vertices):
            stray = mesh.stray
            mesh = mesh.without_stray()
            if not stray or mesh_problem(info.diameter_m, info.lower, mesh.vertices):
                raise FormatError(self._path(obj_id), problem)
            _log.warning("%s: vertices of no face are left out: %d", self._path(obj_id), stray)
        self._checked.add(obj_id)
        return mesh
