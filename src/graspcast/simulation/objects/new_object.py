"""A new object: from a mesh and a mass to all that a BOP dataset and a catalogue hold of it."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.meshes import Mesh, write_mesh
from graspcast.bop.models import ContinuousSymmetry, ModelInfo
from graspcast.errors import FormatError, InputError
from graspcast.pose.lengths import METRES, UNIT_NAMES, shown
from graspcast.simulation.objects.bodies import check_bodies
from graspcast.simulation.objects.catalogue import ObjectEntry
from graspcast.simulation.objects.collision import CollisionShape, choose_collision
from graspcast.simulation.objects.colours import read_colours
from graspcast.simulation.objects.load import assemble
from graspcast.simulation.objects.meshes import (
    MassProperties,
    Unit,
    mass_of_pieces,
    mass_properties,
    read_mesh,
    read_mesh_and_unit,
)
from graspcast.simulation.objects.plausibility import (
    DENSITIES,
    FRICTIONS,
    check_diameter,
    odd_density,
)
from graspcast.simulation.objects.rest_pose import LARGEST_TILT_RAD, stable_ups
from graspcast.simulation.objects.surface import Surface
from graspcast.simulation.objects.symmetries import Symmetries, find_symmetries
from graspcast.simulation.objects.symmetry_names import stated_symmetries
from graspcast.simulation.objects.types import GraspObject

__all__ = ["NewObject", "Told", "check_mesh", "make_object"]

_USUAL_M = (0.01, 0.5)
_FLAT = 1e-6
_FAR_ORIGIN = 1.0


@dataclass(frozen=True)
class Told:
    """What is told of an object besides its mesh.

    Attributes
    ----------
    mass_kg, density
        Its mass in kilograms, or its mean density in kg/m^3; one of both.
    mass_source
        Where the mass is from.
    friction, friction_source
        Coefficient of sliding friction, and where it is from.
    label
        Name for people; that of the file if None.
    up
        Direction that points up when it stands on the table. If None: z if it stands so, else the
        direction in which its centroid is lowest.
    symmetry
        ``("auto",)`` finds the symmetries; otherwise names such as ``"none"``, ``"z"``, ``"x2"``.
    unit
        Unit of the mesh.
    pieces
        Largest number of collision pieces; chosen by the shape if None.
    open_mesh
        Whether a mesh that is not closed is accepted, with volume, centroid and inertia from its
        collision pieces.
    """

    mass_kg: float | None = None
    density: float | None = None
    mass_source: str = "given"
    friction: float = 0.8
    friction_source: str = "assumed: as that of the built-in objects"
    label: str | None = None
    up: tuple[float, ...] | None = None
    symmetry: tuple[str, ...] = ("auto",)
    unit: Unit = "auto"
    pieces: int | None = None
    open_mesh: bool = False


@dataclass(frozen=True, eq=False)
class NewObject:
    """An object with all that was found about it.

    Attributes
    ----------
    entry
        Its catalogue entry.
    mesh
        Its mesh, metres, in the frame of its file.
    unit
        The unit in which the file was read.
    symmetries
        Its symmetries.
    collision
        Its collision pieces.
    grasp_object
        The object, ready for trials.
    remarks
        What is odd, or was decided, in words.
    colours
        RGB at each vertex of the mesh; None if the file has no colours, or is a BOP model.
    """

    entry: ObjectEntry
    mesh: Mesh
    unit: str
    symmetries: Symmetries
    collision: CollisionShape
    grasp_object: GraspObject
    remarks: tuple[str, ...]
    colours: UInt8[ndarray, "v 3"] | None = None


def make_object(
    path: Path, dataset: str, obj_id: int, told: Told, *, info: ModelInfo | None = None
) -> NewObject:
    """Make an object from a mesh file, with every check that its trials would need.

    Parameters
    ----------
    path
        The mesh: STL, OBJ, PLY or GLB.
    dataset, obj_id
        The dataset, and the object's number in it.
    told
        What is told of it.
    info
        Its entry of ``models_info.json`` if it is a BOP model, whose unit and symmetries stand.

    Raises
    ------
    InputError
        If mesh, mass, density, friction, direction or symmetry is wrong, or if they contradict
        each other; the message names the object, with both numbers.
    """
    label = told.label or (path.stem if info is None else f"{dataset} object {obj_id}")
    what = f"object {dataset}-{obj_id} ({path.name})"
    mesh, read_as, remarks = _checked_mesh(path, what, told, info)
    surface = Surface(mesh.vertices, mesh.faces)
    closed, why_open = _closed(mesh, told, what)
    shape = choose_collision(mesh, surface, closed=closed, pieces=told.pieces)
    mass = _mass(mesh, shape, told, what, closed=closed)
    remarks.append("" if closed else f"{why_open}; volume and inertia are of its collision pieces")
    density = (told.mass_kg or float(told.density or 0) * mass.volume_m3) / mass.volume_m3
    remarks.append(odd_density(what, density))
    up, chosen = _up(shape, mass.centroid, told)
    remarks.append("" if chosen is None else f"{what}: {chosen}")
    entry = ObjectEntry(
        name=f"{dataset}-{obj_id}",
        label=label,
        mass_kg=_rounded(told.mass_kg or float(told.density or 0) * mass.volume_m3),
        mass_source=told.mass_source if told.density is None else _by_density(told, mass),
        friction=told.friction,
        friction_source=told.friction_source,
        up=up,
        collision=shape.how,
        mesh=path,
        dataset=dataset,
        obj_id=obj_id,
        inertia="mesh" if closed else "pieces",
    )
    symmetries, doubt = _symmetries(surface, told, info)
    remarks.append("" if not doubt else f"{what}: {doubt}")
    return NewObject(
        entry,
        mesh,
        read_as,
        symmetries,
        shape,
        assemble(entry, mesh),
        tuple(remark for remark in remarks if remark),
        None if info is not None else read_colours(path, mesh, read_as),
    )


def check_mesh(
    path: Path, dataset: str, obj_id: int, told: Told, *, info: ModelInfo | None = None
) -> None:
    """Raise what :func:`make_object` raises of a file and of numbers, before the slow steps.

    Parameters are those of :func:`make_object`.
    """
    what = f"object {dataset}-{obj_id} ({path.name})"
    mesh, _, _ = _checked_mesh(path, what, told, info)
    _closed(mesh, told, what)


def _checked_mesh(
    path: Path, what: str, told: Told, info: ModelInfo | None
) -> tuple[Mesh, str, list[str]]:
    """Read and check a mesh; return it, the unit in which it was read, and remarks."""
    _check_numbers(what, told)
    unit: Unit = "mm" if info is not None else told.unit
    mesh, read_as = read_mesh_and_unit(path, unit)
    if info is not None:
        check_diameter(what, mesh.vertices, info.diameter_m)
    _check_volume(path, mesh)
    mesh = mesh if info is not None else _as_written(mesh)
    if info is None:
        _check_usual(path, mesh, told, read_as)
    return mesh, read_as, [check_bodies(what, mesh), _far_origin(what, mesh)]


def _check_numbers(what: str, told: Told) -> None:
    if (told.mass_kg is None) == (told.density is None):
        both = "both are given" if told.mass_kg is not None else "neither is given"
        raise InputError(
            f"{what}: its mass or its density is needed, and {both}", parameters=("mass", "density")
        )
    if told.mass_kg is not None and not (isfinite(told.mass_kg) and told.mass_kg > 0):
        raise InputError(
            f"{what}: its mass is {told.mass_kg} kg, and must be finite and above zero",
            parameters=("mass",),
        )
    low, high = DENSITIES
    if told.density is not None and not low <= told.density <= high:
        hint = "; is it in g/cm³?" if low <= 1000 * told.density <= high else ""
        raise InputError(
            f"{what}: its density is {told.density:g} kg/m³, but objects have {low:g} to "
            f"{high:,g} kg/m³{hint}",
            parameters=("density",),
        )
    low, high = FRICTIONS
    if not low <= told.friction <= high:
        raise InputError(
            f"{what}: its friction is {told.friction:g}, but coefficients of friction lie between "
            f"{low:g} (ice) and {high:g} (soft rubber)",
            parameters=("friction",),
        )


def _check_volume(path: Path, mesh: Mesh) -> None:
    spread = np.linalg.svd(mesh.vertices - mesh.vertices.mean(axis=0), compute_uv=False)
    if len(mesh.vertices) < 4 or spread[-1] <= _FLAT * spread[0]:
        raise FormatError(path, "is flat: all its vertices lie in one plane, so it has no volume")


def _as_written(mesh: Mesh) -> Mesh:
    """Return a mesh as it is read from its BOP model, which has single precision."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "model.ply"
        write_mesh(path, mesh)
        return read_mesh(path, "mm")


def _check_usual(path: Path, mesh: Mesh, told: Told, read_as: str) -> None:
    """Ask for the unit where the size in millimetres is unusual and no mass tells it."""
    across = float(np.ptp(mesh.vertices, axis=0).max())
    if told.unit != "auto" or read_as != "mm" or told.density is None or across >= _USUAL_M[0]:
        return
    number = across / METRES["mm"]
    sizes = {unit: number * METRES[unit] for unit in ("cm", "inch")}
    others = [f"{UNIT_NAMES[u]} ({shown(x)})" for u, x in sizes.items() if x <= _USUAL_M[1]]
    raise FormatError(
        path,
        f"is {shown(across)} across if it is in millimetres, but may be in {' or '.join(others)}; "
        "give its unit",
        parameters=("unit",),
    )


def _far_origin(what: str, mesh: Mesh) -> str:
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    away = float(np.linalg.norm(np.maximum(0, np.maximum(low, -high))))
    if away <= _FAR_ORIGIN * float((high - low).max()):
        return ""
    return (
        f"{what}: the origin of its frame is {shown(away)} outside of the object, so a small error "
        "of rotation about it moves the object far; most datasets have it in the middle"
    )


def _closed(mesh: Mesh, told: Told, what: str) -> tuple[bool, str]:
    try:
        mass_properties(mesh.vertices, mesh.faces, 1.0, what)
    except InputError as error:
        if "inverted" in str(error) or not told.open_mesh:
            hint = "" if "inverted" in str(error) else ". Or accept it as it is"
            raise InputError(f"{error}{hint}", parameters=("open_mesh",) if hint else ()) from error
        return False, str(error).partition(", so its")[0]
    return True, ""


def _mass(
    mesh: Mesh, shape: CollisionShape, told: Told, what: str, *, closed: bool
) -> MassProperties:
    mass_kg = told.mass_kg or 1.0
    if closed:
        return mass_properties(mesh.vertices, mesh.faces, mass_kg, what)
    return mass_of_pieces(shape.pieces, mass_kg, what)


def _by_density(told: Told, mass: MassProperties) -> str:
    return f"{told.density:g} kg/m³ in {mass.volume_m3 * 1e6:.3g} cm³"


def _rounded(mass_kg: float) -> float:
    return float(f"{mass_kg:.4g}")


def _up(
    shape: CollisionShape, centroid: Float[ndarray, " 3"], told: Told
) -> tuple[tuple[float, ...], str | None]:
    """Return the direction that points up, and what is to be said if it was chosen."""
    if told.up is not None:
        return told.up, None
    ups, heights = stable_ups(shape.pieces, centroid)
    upright = np.cos(LARGEST_TILT_RAD)
    if (ups[:, 2] >= upright).any():
        return (0.0, 0.0, 1.0), None
    lowest = ups[np.argmin(heights)]
    up = tuple(float(x) + 0.0 for x in np.round(lowest, 3))
    words = ", ".join(f"{x:g}" for x in up)
    said = f"it does not stand with z up; it lies with ({words}) up, its centroid lowest"
    axes = [("y", ups[:, 1]), ("-y", -ups[:, 1]), ("x", ups[:, 0]), ("-x", -ups[:, 0])]
    others = [name for name, along in axes if (along >= upright).any()]
    return up, said + (f"; it would also stand with {' or '.join(others)} up" if others else "")


def _symmetries(surface: Surface, told: Told, info: ModelInfo | None) -> tuple[Symmetries, str]:
    if info is not None:
        continuous: tuple[ContinuousSymmetry, ...] = info.continuous
        return Symmetries(continuous, info.discrete), ""
    if told.symmetry == ("auto",):
        return find_symmetries(surface), ""
    return stated_symmetries(surface, told.symmetry)
