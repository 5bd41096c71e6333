"""Plausibility of objects: size, density, collision primitives and grasps held against each other.

A mesh states no unit, and a catalogue is written by hand. So every number is compared with another
one of the same object; a contradiction is an error with both numbers and the unit that would fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.pose.lengths import METRES, UNIT_NAMES, Reference, shown, unit_problem
from graspcast.simulation.objects.types import ConvexPiece, Grasp, GraspObject, Primitive

__all__ = [
    "DENSITIES",
    "FRICTIONS",
    "FRICTION_IN_WORDS",
    "GRASPABLE",
    "by_sides",
    "check_density",
    "check_diameter",
    "check_grasp_is_near",
    "check_primitives",
    "density_of",
    "describe_object",
    "is_friction",
    "odd_density",
]

_USUAL_SIZES = (0.01, 0.5)

GRASPABLE = Reference("a hand grasps objects of 5 mm to 1 m", 0.005, 1.0, _USUAL_SIZES)
"""Range of the largest side of the bounding box that a single hand can grasp."""

DENSITIES = (20.0, 25_000.0)
"""Range of the mean density of an object, kg/m3: from foam to the densest metals."""

FRICTIONS = (0.05, 3.0)
"""Range of coefficients of friction, from ice to soft rubber."""

FRICTION_IN_WORDS = f"from 0 to {FRICTIONS[1]:g} (soft rubber)"
"""What :func:`is_friction` demands, for messages."""

_USUAL_DENSITIES = (60.0, 12_000.0)
_DENSEST_USUAL = 9_000.0
_FARTHEST_GRASP_M, _NEAR_GRASP_M = 0.25, 0.02
_SLACK_M = 0.005
_SIDES = (0.4, 1.6)


def is_friction(value: float) -> bool:
    """Return whether a number may be a coefficient of friction; 0 may."""
    return 0 <= value <= FRICTIONS[1]


def check_density(
    what: str,
    mass_kg: float,
    volume_m3: float,
    size_m: float,
    *,
    parameters: tuple[str, ...] = ("catalogue", "mass", "unit"),
) -> None:
    """Check that mass and volume of an object give a density that exists.

    Parameters
    ----------
    what
        The object's name in messages.
    mass_kg, volume_m3
        Mass and enclosed volume.
    size_m
        Largest side of its bounding box, by which units that cannot be are left out.
    parameters
        By which to mend it.

    Raises
    ------
    InputError
        With both numbers, and the units that would fit.
    """
    density = mass_kg / volume_m3
    if DENSITIES[0] <= density <= DENSITIES[1]:
        return
    meant = []
    if _USUAL_DENSITIES[0] <= 1e-3 * density <= _USUAL_DENSITIES[1]:
        meant.append(f"the mass in grams ({1e-3 * mass_kg:.3g} kg)")
    for unit, read in ((a, b) for b in ("mm", "m") for a in METRES if a != b):
        factor = METRES[unit] / METRES[read]
        usual = _USUAL_DENSITIES[0] <= density / factor**3 <= _USUAL_DENSITIES[1]
        if usual and _USUAL_SIZES[0] <= size_m * factor <= _USUAL_SIZES[1]:
            names = f"{UNIT_NAMES[unit]}, not in {UNIT_NAMES[read]}"
            meant.append(f"the mesh in {names} ({shown(size_m * factor)} across)")
    raise InputError(
        f"{what}: {mass_kg:.4g} kg in {volume_m3 * 1e6:.4g} cm³ ({shown(size_m)} across) are "
        f"{_grouped(density)} kg/m³, but objects have {_grouped(DENSITIES[0])} to "
        f"{_grouped(DENSITIES[1])} kg/m³; "
        + (f"is {' or '.join(meant)}?" if meant else "correct the mass or the mesh's unit"),
        parameters=parameters,
    )


def odd_density(what: str, density: float) -> str:
    """Return a remark on a density that few objects have, kg/m3; empty if it is usual."""
    if density <= _DENSEST_USUAL:
        return ""
    return (
        f"{what}: its {_grouped(density)} kg/m³ are more than those of steel (7,850) and copper "
        "(8,960); is its mass right?"
    )


def check_diameter(what: str, vertices: Float[ndarray, "v 3"], diameter_m: float) -> None:
    """Check the diameter that ``models_info.json`` states against the mesh.

    Raises
    ------
    MismatchError
        If no object with that bounding box has that diameter, with both numbers.
    """
    sides = np.ptp(vertices, axis=0)
    across, diagonal = float(sides.max()), float(np.linalg.norm(sides))
    mesh = Reference(f"its mesh is {shown(across)} across", 0.9 * across, 1.1 * diagonal)
    stated = "its diameter in models_info.json"
    if problem := unit_problem(stated, diameter_m, mesh, unit="mm"):
        raise MismatchError(f"{what}: {problem}", parameters=("bop",))


def check_primitives(
    what: str, pieces: Sequence[Primitive], vertices: Float[ndarray, "v 3"]
) -> None:
    """Check that collision primitives are about as large as the mesh, and where it is.

    Raises
    ------
    MismatchError
        With the sides of both bounding boxes.
    """
    boxes = [_bounds(piece) for piece in pieces]
    low = np.min([b[0] for b in boxes], axis=0)
    high = np.max([b[1] for b in boxes], axis=0)
    sides, wanted = high - low, np.ptp(vertices, axis=0)
    both = f"{what}: its collision primitives are {_by(sides)} large, but its mesh is {_by(wanted)}"
    ratio = float(sides.max() / wanted.max())
    larger = sides > _SIDES[1] * wanted + _SLACK_M
    smaller = sides < _SIDES[0] * wanted - _SLACK_M
    if larger.any() or smaller.any():
        units = {f: u for u, f in ((u, 1 / METRES[u]) for u in METRES) if f != 1}
        unit = next((u for f, u in units.items() if 0.6 <= ratio / f <= 1.6), None)
        if unit is not None:
            remedy = f"is size_m in {UNIT_NAMES[unit]}, not in metres?"
        elif larger.any() and not smaller.any() and ratio < 3:
            remedy = (
                "size_m holds half of each side (of a cylinder the radius and half its height), "
                "as in MuJoCo; are these whole sides?"
            )
        else:
            remedy = "make them about as large as the mesh, or check the mesh's unit"
        raise MismatchError(f"{both}; {remedy}", parameters=("catalogue",))
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    apart = float(np.linalg.norm((low + high) / 2 - middle))
    if apart > 0.5 * float(np.linalg.norm(wanted)) + _SLACK_M:
        raise MismatchError(
            f"{what}: the middle of its collision primitives is {shown(apart)} from that of its "
            f"mesh, which is {_by(wanted)} large; position_m is in metres, in the mesh's frame",
            parameters=("catalogue",),
        )


def check_grasp_is_near(grasp: Grasp, grasp_object: GraspObject) -> None:
    """Check that a grasp is at its object.

    Raises
    ------
    MismatchError
        If the tool centre point is farther from the object's bounding box than any hand reaches.
    """
    point = grasp.obj_T_grasp[:3, 3]
    low, high = grasp_object.vertices.min(axis=0), grasp_object.vertices.max(axis=0)

    def gap(factor: float) -> float:
        moved = point * factor
        return float(np.linalg.norm(np.maximum(0, np.maximum(low - moved, moved - high))))

    away = gap(1.0)
    if away <= _FARTHEST_GRASP_M:
        return
    units = [unit for unit in METRES if unit != "m" and gap(METRES[unit]) <= _NEAR_GRASP_M]
    names = " or ".join(UNIT_NAMES[unit] for unit in units)
    raise MismatchError(
        f"the grasp of {grasp} is {shown(away)} away from the "
        f"object, which is {shown(float((high - low).max()))} across; "
        + (
            f"is position_m in {names}, not in metres?"
            if units
            else "position_m is that of the tool centre point in the object's frame, in metres"
        ),
        parameters=("grasps",),
    )


def describe_object(grasp_object: GraspObject) -> str:
    """Return size, mass and density in a few words: ``"102 mm, 0.31 kg, 480 kg/m³"``."""
    across = float(np.ptp(grasp_object.vertices, axis=0).max())
    text = f"{shown(across)}, {grasp_object.mass_kg:.3g} kg"
    return f"{text}, {density_of(grasp_object)}" if grasp_object.volume_m3 > 0 else text


def density_of(grasp_object: GraspObject) -> str:
    """Return the mean density of an object in words: ``"480 kg/m³"``."""
    return f"{_grouped(grasp_object.mass_kg / grasp_object.volume_m3)} kg/m³"


def by_sides(vertices: Float[ndarray, "v 3"]) -> str:
    """Return the sides of a bounding box in words: ``"100 x 80 x 61 mm"``."""
    return _by(np.ptp(vertices, axis=0))


def _bounds(piece: Primitive | ConvexPiece) -> tuple[ndarray, ndarray]:
    if isinstance(piece, ConvexPiece):
        return piece.vertices.min(axis=0), piece.vertices.max(axis=0)
    rotation, size = piece.obj_T_geom[:3, :3], np.array(piece.size)
    if piece.kind == "box":
        half = np.abs(rotation) @ size
    elif piece.kind == "sphere":
        half = np.full(3, size[0])
    else:
        along = np.abs(rotation[:, 2])
        half = np.sqrt(np.clip(1 - along**2, 0, 1)) * size[0] + along * size[1]
    middle = piece.obj_T_geom[:3, 3]
    return middle - half, middle + half


def _by(sides: ndarray) -> str:
    if sides.max() < 0.5:
        return " x ".join(f"{1000 * side:.3g}" for side in sides) + " mm"
    return " x ".join(f"{side:.3g}" for side in sides) + " m"


def _grouped(number: float) -> str:
    return f"{number:,.0f}" if number >= 10 else f"{number:.2g}"
