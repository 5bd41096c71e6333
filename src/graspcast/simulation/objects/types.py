"""Objects to be grasped, with their collision shape, and grasps of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.estimates.outcomes import REFERENCE_GRASP

__all__ = [
    "ConvexPiece",
    "Grasp",
    "GraspObject",
    "Piece",
    "Primitive",
    "box_corners",
    "check_rigid",
]

_RIGID_TOLERANCE = 1e-6


@dataclass(frozen=True)
class ConvexPiece:
    """Convex mesh as a piece of an object's collision shape, metres, in the object's frame."""

    vertices: Float[ndarray, "v 3"]
    faces: Int[ndarray, "f 3"]


@dataclass(frozen=True)
class Primitive:
    """Box, cylinder or sphere as a piece of an object's collision shape.

    Attributes
    ----------
    kind
        The shape.
    size
        Metres, as in MuJoCo: three half sizes of a box, (radius, half height) of a cylinder along
        its z axis, (radius,) of a sphere.
    obj_T_geom
        Pose of the shape in the object's frame.
    """

    kind: Literal["box", "cylinder", "sphere"]
    size: tuple[float, ...]
    obj_T_geom: Float[ndarray, "4 4"]


Piece = ConvexPiece | Primitive


@dataclass(frozen=True, eq=False)
class GraspObject:
    """Object that can be grasped, in its own frame; metres, kilograms.

    Attributes
    ----------
    name
        For example ``"lmo-1"``, ``"ycbv-4"`` or ``"mug"``.
    vertices
        The mesh, in the object's frame.
    faces
        Triangles of the mesh, as vertex numbers.
    pieces
        The collision shape.
    mass_kg
        Mass.
    friction
        Coefficient of sliding (Coulomb) friction against fingers and table.
    centroid
        Centre of mass at uniform density.
    inertia
        Inertia tensor about the centroid, in the object's axes, kg m^2.
    sim_T_ref
        The reference pose: the object at rest on the table, which is the plane z = 0.

    Raises
    ------
    InputError
        If the mass is not positive, the friction negative, the inertia not positive definite, the
        reference pose not a rigid transform, or there is no collision piece.
    """

    name: str
    vertices: Float[ndarray, "v 3"]
    faces: Int[ndarray, "f 3"]
    pieces: tuple[Piece, ...]
    mass_kg: float
    friction: float
    centroid: Float[ndarray, " 3"]
    inertia: Float[ndarray, "3 3"]
    sim_T_ref: Float[ndarray, "4 4"]

    def __post_init__(self) -> None:
        who = f"object {self.name!r}"
        if not (np.isfinite(self.mass_kg) and self.mass_kg > 0):
            raise InputError(f"{who}: its mass is {self.mass_kg} kg; give one above zero")
        if not (np.isfinite(self.friction) and self.friction >= 0):
            raise InputError(f"{who}: its friction is {self.friction}; give a number >= 0")
        if not self.pieces:
            raise InputError(f"{who}: it has no collision piece, so nothing could touch it")
        if not np.all(np.isfinite(self.inertia)) or np.linalg.eigvalsh(self.inertia)[0] <= 0:
            raise InputError(f"{who}: its inertia is not positive definite; is its mesh closed?")
        check_rigid(self.sim_T_ref, f"{who}: its reference pose")

    @cached_property
    def volume_m3(self) -> float:
        """Volume that the mesh encloses; zero without faces."""
        a, b, c = np.moveaxis(self.vertices[self.faces] - self.centroid, 1, 0)
        return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


@dataclass(frozen=True, eq=False)
class Grasp:
    """Grasp: pose of the gripper's tool centre point (TCP) in the object's frame.

    In the TCP's frame z is the direction of approach, from the palm out along the fingers, and x
    the direction in which the fingers close.

    Attributes
    ----------
    obj_T_grasp
        Pose of the TCP's frame in the object's frame.
    object
        The object's name.
    gripper
        The gripper's name.
    name
        The grasp's name, which tells it from others of the same object and gripper.
    """

    obj_T_grasp: Float[ndarray, "4 4"]
    object: str
    gripper: str
    name: str = REFERENCE_GRASP

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InputError(f"the name of a grasp should be text, not {self.name!r}")
        check_rigid(self.obj_T_grasp, f"the grasp of {self}")
        if not self.name or self.name != self.name.strip() or not self.name.isprintable():
            raise InputError(
                f"a grasp of {self.object!r} by {self.gripper!r} is named {self.name!r}; give a "
                "name without line breaks, and without spaces around it"
            )

    def __str__(self) -> str:
        """``'ycbv-4' by 'parallel'``, and the name of a grasp that is not the reference grasp."""
        which = "" if self.name == REFERENCE_GRASP else f", grasp {self.name!r}"
        return f"{self.object!r} by {self.gripper!r}{which}"


def box_corners(half: Sequence[float] | ndarray) -> Float[ndarray, "*batch 8 3"]:
    """Return the corners of boxes about the origin, from their half sizes (..., 3)."""
    signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3)
    corners: ndarray = signs * np.asarray(half)[..., None, :]
    return corners


def check_rigid(a_T_b: Float[ndarray, "4 4"], what: str) -> None:
    """Raise InputError unless ``a_T_b`` is a finite rigid transform (to 1e-6).

    Parameters
    ----------
    a_T_b
        The transform.
    what
        Its name in the message.
    """
    if not isinstance(a_T_b, ndarray) or a_T_b.shape != (4, 4) or not np.all(np.isfinite(a_T_b)):
        raise InputError(f"{what} must be a finite 4x4 transform, got {a_T_b!r}")
    rotation = a_T_b[:3, :3]
    orthogonal = np.abs(rotation @ rotation.T - np.eye(3)).max() <= _RIGID_TOLERANCE
    if not orthogonal or np.linalg.det(rotation) < 0 or not np.array_equal(a_T_b[3], [0, 0, 0, 1]):
        raise InputError(f"{what} must be a rigid transform (no scale, no shear), got {a_T_b}")
