"""Table of grasps, one or several for each object and gripper, read from TOML files."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from graspcast.errors import FormatError, InputError, UnknownNameError
from graspcast.estimates.outcomes import REFERENCE_GRASP
from graspcast.io.arguments import PATH, a, checked, refuse_unless, sequence
from graspcast.io.files import write_text
from graspcast.io.toml import TomlTable, read_toml
from graspcast.pose.transforms import quaternion, rotation_from_quaternion, transform
from graspcast.simulation.objects.load import with_physics
from graspcast.simulation.objects.plausibility import (
    FRICTION_IN_WORDS,
    check_density,
    check_grasp_is_near,
    is_friction,
)
from graspcast.simulation.objects.types import Grasp, GraspObject
from graspcast.simulation.trial.settings import Protocol

__all__ = ["GraspTable", "ReferenceGrasp", "grasps_in", "read_grasps", "write_grasps"]

Figure = str | int | float | bool
_MOST_NAMED = 6
_HEADER = """\
# Grasps: pose of the gripper's tool centre point in the object's frame. Its z is the
# direction of approach, its x the direction in which the fingers close. Metres; quaternions wxyz.
"""


@dataclass(frozen=True, eq=False)
class ReferenceGrasp:
    """Grasp of an object by a gripper, with its provenance.

    Attributes
    ----------
    grasp
        The grasp.
    provenance
        How it was found, as text.
    mass_kg, friction
        Values that replace the object's own in trials with this gripper.
    agreement
        Figures by name: agreement of simulated with observed outcomes in each split, the number of
        candidates tried.
    """

    grasp: Grasp
    provenance: str
    mass_kg: float | None = None
    friction: float | None = None
    agreement: Mapping[str, Figure] = field(default_factory=dict)

    def applied_to(self, grasp_object: GraspObject) -> GraspObject:
        """Return the object with the mass and friction of this grasp.

        Raises
        ------
        InputError
            If the grasp is nowhere near the object, or its mass does not fit the object's volume.
        """
        check_grasp_is_near(self.grasp, grasp_object)
        if self.mass_kg is not None and grasp_object.volume_m3 > 0:
            across = float(np.ptp(grasp_object.vertices, axis=0).max())
            check_density(
                f"the grasp of {self.grasp}",
                self.mass_kg,
                grasp_object.volume_m3,
                across,
                parameters=("grasps",),
            )
        return with_physics(grasp_object, mass_kg=self.mass_kg, friction=self.friction)


class GraspTable:
    """Grasps by object and gripper, one or several of each, in the order of the files."""

    def __init__(self, grasps: Iterable[ReferenceGrasp]):
        self._grasps: dict[tuple[str, str], dict[str, ReferenceGrasp]] = {}
        for reference in grasps:
            grasp = reference.grasp
            named = self._grasps.setdefault((grasp.object, grasp.gripper), {})
            if grasp.name in named:
                raise InputError(f"there are two grasps of {grasp}; keep one, or name them")
            named[grasp.name] = reference

    def __call__(self, object_name: str, gripper: str, name: str | None = None) -> ReferenceGrasp:
        """Return a grasp of an object by a gripper.

        Parameters
        ----------
        object_name, gripper
            Names of object and gripper.
        name
            The grasp's name. If None, the reference grasp; or, where none has that name, the first.

        Raises
        ------
        UnknownNameError
            If there is none; the message lists the grippers that have one, or the grasps.
        """
        named = self._named(object_name, gripper)
        if name is None:
            return named.get(REFERENCE_GRASP) or next(iter(named.values()))
        if name not in named:
            raise UnknownNameError(
                f"grasp of {object_name!r} by {gripper!r} named",
                name,
                list(named),
                parameters=("grasp",),
            )
        return named[name]

    def of(self, object_name: str, gripper: str) -> tuple[ReferenceGrasp, ...]:
        """Return all grasps of an object by a gripper, in the order of the file.

        Raises
        ------
        UnknownNameError
            If there is none; the message lists the grippers that have one.
        """
        return tuple(self._named(object_name, gripper).values())

    def _named(self, object_name: str, gripper: str) -> dict[str, ReferenceGrasp]:
        named = self._grasps.get((object_name, gripper))
        if named is None:
            raise UnknownNameError(
                f"grasp of {object_name!r} by",
                gripper,
                [g for o, g in self._grasps if o == object_name],
                hint="graspcast propose-grasps finds grasps and writes them to such a file",
                parameters=("grasps",),
            )
        return named

    def __contains__(self, pair: object) -> bool:
        return pair in self._grasps

    def __iter__(self) -> Iterator[ReferenceGrasp]:
        return (reference for named in self._grasps.values() for reference in named.values())

    def __len__(self) -> int:
        return sum(map(len, self._grasps.values()))

    def updated(self, grasps: Iterable[ReferenceGrasp]) -> GraspTable:
        """Return this table, with other grasps for the objects and grippers of the given ones."""
        new = GraspTable(grasps)
        kept = [r for r in self if (r.grasp.object, r.grasp.gripper) not in new]
        return GraspTable([*kept, *new])

    def limited(self, names: Sequence[str] = (), most: int | None = None) -> GraspTable:
        """Return the grasps of some names, and at most so many of each object and gripper.

        Parameters
        ----------
        names
            Names of grasps; all if there are none.
        most
            How many of each object and gripper are kept, the first ones; all if None.

        Raises
        ------
        UnknownNameError
            For a name that no grasp has.
        """
        known = sorted({reference.grasp.name for reference in self})
        for name in names:
            if name not in known:
                raise UnknownNameError("grasp", name, known, parameters=("grasp",))
        kept = (
            [r for r in named.values() if not names or r.grasp.name in names][:most]
            for named in self._grasps.values()
        )
        return GraspTable(reference for some in kept for reference in some)

    def pairs(
        self, objects: Iterable[str], grippers: Sequence[str], *, strict: bool
    ) -> list[tuple[str, str]]:
        """Return the pairs of the given objects and grippers that have a grasp.

        Raises
        ------
        InputError
            If none has one or, if ``strict``, any has none.
        """
        pairs = [(name, gripper) for name in sorted(objects) for gripper in grippers]
        known = [pair for pair in pairs if pair in self]
        if not known or (strict and len(known) < len(pairs)):
            lacking = ", ".join(f"{o} by {g}" for o, g in pairs if (o, g) not in self)
            named = {name for name, _ in pairs}
            near = [f"{o} by {g}" for o, g in self._grasps if o in named]
            there = near or [f"{o} by {g}" for o, g in self._grasps if g in grippers]
            more = ", …" if len(there) > _MOST_NAMED else ""
            there = there[: -_MOST_NAMED - 1 : -1]  # those of the user's file, which come last
            told = f"there are grasps of {', '.join(there)}" if there else "there is no other grasp"
            raise InputError(
                f"no grasp of {lacking}; {told}{more}. An object of a dataset is named "
                "DATASET-NUMBER, in grasps and catalogue too; graspcast propose-grasps finds "
                "grasps",
                parameters=("objects", "grasps"),
            )
        return known


@checked(path=PATH, protocol=(lambda value: value in ("robot", "paper"), "robot or paper"))
def read_grasps(
    path: str | PathLike[str] | None = None, *, protocol: Protocol = "robot"
) -> GraspTable:
    """Read the built-in grasps and those of a file, which take precedence.

    By the paper's protocol the built-in grasps are those that reproduce the published outcomes.
    They are no grasps for a robot: some drop a perfect estimate, as the published outcomes say.

    Where the file has grasps of an object by a gripper, the built-in one does not count. A file has
    one entry per grasp::

        [[grasp]]
        object = "ycbv-4"
        gripper = "parallel"
        name = "top"                        # optional: "reference" if left out
        position_m = [0.0, 0.0, 0.03]
        quaternion = [0.0, 1.0, 0.0, 0.0]   # wxyz of obj_T_grasp
        provenance = "from the top, by hand"
        friction = 0.7                      # optional, as is mass_kg; for this gripper only

        [grasp.agreement]                   # optional figures
        candidates = 24

    Raises
    ------
    FormatError
        If the file is not valid; the message names the entry and the key.
    """
    folder = files("graspcast.simulation.grasps")
    table = GraspTable(grasps_in(str(folder / "grasps.toml")))
    if protocol == "paper":
        table = table.updated(grasps_in(str(folder / "paper_grasps.toml")))
    return table if path is None else table.updated(grasps_in(path))


@checked(path=PATH)
def write_grasps(path: str | PathLike[str], grasps: Iterable[ReferenceGrasp]) -> None:
    """Write grasps to a TOML file, atomically; reading gives the same numbers.

    They are sorted by object and gripper. Those of the same pair keep their order.

    Raises
    ------
    InputError
        If two grasps of a pair have one name, which would not be read again.
    """
    grasps = list(grasps) if isinstance(grasps, Iterable) else grasps
    refuse_unless(sequence(a(ReferenceGrasp)), grasps, "write_grasps", "grasps")
    GraspTable(grasps)  # no two of one name
    ordered = sorted(grasps, key=lambda r: (_natural(r.grasp.object), r.grasp.gripper))
    write_text(path, "\n".join([_HEADER, *(_entry_text(reference) for reference in ordered)]))


def grasps_in(path: str | PathLike[str]) -> list[ReferenceGrasp]:
    """Read the grasps of one file only; raises as :func:`read_grasps`."""
    path = Path(path)
    tables = read_toml(path)
    outer = TomlTable(path, "the file", tables)
    entries = outer.take("grasp", list, [])
    outer.nothing_else()
    out = [_entry(TomlTable(path, f"grasp[{i}]", entry)) for i, entry in enumerate(entries)]
    try:
        GraspTable(out)
    except InputError as error:
        raise FormatError(path, str(error)) from error
    return out


def _entry(table: TomlTable) -> ReferenceGrasp:
    object_name, gripper = table.take("object", str), table.take("gripper", str)
    for key, given in (("object", object_name), ("gripper", gripper)):
        if not given.strip():
            raise table.error(key, f"is {given!r}; give the {key}'s name")
    name = table.take("name", str, REFERENCE_GRASP)
    table.where += f" ({object_name} by {gripper})"
    position = np.array(table.numbers("position_m", 3))
    wxyz = np.array(table.numbers("quaternion", 4))
    if abs(np.linalg.norm(wxyz) - 1) > 1e-3:
        raise table.error("quaternion", f"has length {np.linalg.norm(wxyz):.4g}, not 1")

    def optional(key: str, holds: Callable[[float], bool], condition: str) -> float | None:
        if key not in table.values:
            table.take(key, float, None)
            return None
        return table.number(key, holds, condition)

    pose = transform(rotation_from_quaternion(wxyz), position)
    try:
        grasp = Grasp(obj_T_grasp=pose, object=object_name, gripper=gripper, name=name)
    except InputError as error:
        raise FormatError(table.path, str(error), where=table.where) from error
    reference = ReferenceGrasp(
        grasp=grasp,
        provenance=table.take("provenance", str),
        mass_kg=optional("mass_kg", lambda x: x > 0, "above zero"),
        friction=optional("friction", is_friction, FRICTION_IN_WORDS),
        agreement=dict(table.take("agreement", dict, {})),
    )
    table.nothing_else()
    for key, value in reference.agreement.items():
        if not isinstance(value, Figure):
            raise table.error(f"agreement.{key}", f"should be a number or text, not {value!r}")
    return reference


def _entry_text(reference: ReferenceGrasp) -> str:
    pose = reference.grasp.obj_T_grasp
    pairs: dict[str, Any] = {
        "object": reference.grasp.object,
        "gripper": reference.grasp.gripper,
        "name": None if reference.grasp.name == REFERENCE_GRASP else reference.grasp.name,
        "position_m": [float(x) for x in pose[:3, 3]],
        "quaternion": [float(x) for x in quaternion(pose[:3, :3])],
        "mass_kg": reference.mass_kg,
        "friction": reference.friction,
        "provenance": reference.provenance,
    }
    # Text, finite numbers, booleans and lists of numbers look the same in TOML as in JSON.
    lines = ["[[grasp]]"]
    lines += [f"{k} = {json.dumps(v)}" for k, v in pairs.items() if v is not None]
    if reference.agreement:
        lines += ["", "[grasp.agreement]"]
        lines += [f"{json.dumps(k)} = {_figure(k, v)}" for k, v in reference.agreement.items()]
    return "\n".join(lines) + "\n"


def _figure(key: str, value: Figure) -> str:
    if not isinstance(value, Figure):
        raise InputError(f"the agreement figure {key!r} is {value!r}, not a number or text")
    return str(value) if isinstance(value, float) else json.dumps(value)  # TOML knows nan, inf


def _natural(name: str) -> tuple[str, int, str]:
    head, _, tail = name.rpartition("-")
    return (head, int(tail), "") if tail.isdecimal() else (name, 0, "")
