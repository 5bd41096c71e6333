"""What a trial is about: an object with its collision shape, and a grasp of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import InputError

__all__ = ["ConvexPiece", "Grasp", "GraspObject", "Piece", "Primitive", "check_rigid"]

_RIGID_TOLERANCE = 1e-6


@dataclass(frozen=True)
class ConvexPiece:
    """One convex piece of an object's collision shape, in metres, in the object's frame."""

    vertices: Float[ndarray, "v 3"]
    faces: Int[ndarray, "f 3"]


@dataclass(frozen=True)
class Primitive:
    """A box, cylinder or sphere as a piece of an object's collision shape.

    ``size`` is in metres, as MuJoCo has it: a box's three half sizes, a cylinder's (radius, half
    height) along its z axis, a sphere's (radius,).
    """

    kind: Literal["box", "cylinder", "sphere"]
    size: tuple[float, ...]
    obj_T_geom: Float[ndarray, "4 4"]


Piece = ConvexPiece | Primitive


@dataclass(frozen=True, eq=False)
class GraspObject:
    """An object that can be grasped, in its own frame; metres, kilograms.

    Attributes
    ----------
    name
        For example ``"lmo-1"`` or ``"ycbv-4"``, or a user's own name.
    vertices
        The mesh, in the object's frame.
    faces
        Triangles of the mesh.
    pieces
        The collision shape.
    mass_kg
        Mass.
    friction
        Coefficient of sliding (Coulomb) friction against fingers and table.
    centroid
        Centre of mass at uniform density.
    inertia
        Moments about the centroid along the object's axes, kg m^2.
    sim_T_ref
        The reference pose: the object at rest on the table, which is the plane z = 0.

    Raises
    ------
    InputError
        For a mass that is not positive, a negative friction, no collision piece, an inertia that no
        body has, or a reference pose that is not a rigid transform.
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


@dataclass(frozen=True, eq=False)
class Grasp:
    """A reference grasp: where the gripper's tool centre point (TCP) goes, seen from the object.

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
    """

    obj_T_grasp: Float[ndarray, "4 4"]
    object: str
    gripper: str

    def __post_init__(self) -> None:
        check_rigid(self.obj_T_grasp, f"the grasp of {self.object!r} by {self.gripper!r}")


def check_rigid(a_T_b: Float[ndarray, "4 4"], what: str) -> None:
    """Raise InputError unless ``a_T_b`` is a finite rigid transform (to 1e-6)."""
    if np.shape(a_T_b) != (4, 4) or not np.all(np.isfinite(a_T_b)):
        raise InputError(f"{what} must be a finite 4x4 transform, got {a_T_b!r}")
    rotation = a_T_b[:3, :3]
    orthogonal = np.abs(rotation @ rotation.T - np.eye(3)).max() <= _RIGID_TOLERANCE
    if not orthogonal or np.linalg.det(rotation) < 0 or not np.array_equal(a_T_b[3], [0, 0, 0, 1]):
        raise InputError(f"{what} must be a rigid transform (no scale, no shear), got {a_T_b}")
