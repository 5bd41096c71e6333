"""Objects of simple shape with exact inertia, for trials."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import exp
from graspcast.simulation.objects.types import ConvexPiece, GraspObject, Primitive

IDENTITY = np.eye(4)


def _object(
    name: str,
    piece: Primitive | ConvexPiece,
    moments: Float[ndarray, " 3"],
    sim_T_ref: Float[ndarray, "4 4"],
    mass_kg: float,
    friction: float,
) -> GraspObject:
    return GraspObject(
        name=name,
        vertices=np.zeros((0, 3)),
        faces=np.zeros((0, 3), dtype=np.int64),
        pieces=(piece,),
        mass_kg=mass_kg,
        friction=friction,
        centroid=np.zeros(3),
        inertia=np.diag(moments),
        sim_T_ref=sim_T_ref,
    )


def raised(height: float) -> Float[ndarray, "4 4"]:
    pose = np.eye(4)
    pose[2, 3] = height
    return pose


def cylinder(
    radius: float = 0.033,
    height: float = 0.10,
    *,
    lying: bool = False,
    mass_kg: float = 0.35,
    friction: float = 0.8,
) -> GraspObject:
    """A cylinder about its frame's z, upright or lying along the world's x."""
    sim_T_ref = raised(height / 2)
    if lying:
        sim_T_ref = raised(radius)
        sim_T_ref[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    across = mass_kg * (3 * radius**2 + height**2) / 12
    moments = np.array([across, across, mass_kg * radius**2 / 2])
    piece = Primitive("cylinder", (radius, height / 2), np.eye(4))
    return _object("cylinder", piece, moments, sim_T_ref, mass_kg, friction)


def box(
    x: float = 0.06,
    y: float = 0.06,
    z: float = 0.06,
    *,
    mass_kg: float = 0.35,
    friction: float = 0.8,
    mesh: bool = False,
) -> GraspObject:
    """A box, as a primitive or as the convex hull of its corners."""
    size = np.array([x, y, z])
    moments = mass_kg / 12 * (np.sum(size**2) - size**2)
    piece: Primitive | ConvexPiece = Primitive("box", (x / 2, y / 2, z / 2), np.eye(4))
    if mesh:
        corners = np.array(np.meshgrid(*[(-s / 2, s / 2) for s in size])).reshape(3, -1).T
        piece = ConvexPiece(corners, np.zeros((0, 3), dtype=np.int64))
    return _object("box", piece, moments, raised(z / 2), mass_kg, friction)


def sphere(diameter: float = 0.073, *, mass_kg: float = 0.35, friction: float = 0.8) -> GraspObject:
    moments = np.full(3, 0.1 * mass_kg * diameter**2)
    piece = Primitive("sphere", (diameter / 2,), np.eye(4))
    return _object("sphere", piece, moments, raised(diameter / 2), mass_kg, friction)


def from_above(
    target: GraspObject, height_m: float, *, along_y: bool = False
) -> Float[ndarray, "4 4"]:
    """``obj_T_grasp`` from above, the TCP ``height_m`` over the object's origin.

    The fingers close along the world's x, or y.
    """
    sim_T_tcp = np.diag([1.0, -1.0, -1.0, 1.0])
    if along_y:
        sim_T_tcp[:3, :3] = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
    sim_T_tcp[:3, 3] = target.sim_T_ref[:3, 3] + [0, 0, height_m]
    obj_T_grasp: ndarray = np.linalg.inv(target.sim_T_ref) @ sim_T_tcp
    return obj_T_grasp


def errors(
    rng: np.random.Generator, count: int, distance_m: float, angle_rad: float
) -> list[Float[ndarray, "4 4"]]:
    """Normal errors of estimates, as ``obj_T_est``."""
    scales = np.repeat([distance_m, angle_rad], 3)
    return [exp(scales * rng.normal(size=6)) for _ in range(count)]
