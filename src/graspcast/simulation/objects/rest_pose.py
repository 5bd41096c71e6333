"""Rest pose of an object on the table: the stable pose nearest to a given direction."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.transforms import rotation_from_vector, transform, transform_points
from graspcast.simulation.objects.types import ConvexPiece, Piece, box_corners

__all__ = ["rest_pose", "stable_ups"]

LARGEST_TILT_RAD = np.deg2rad(20.0)
"""Largest angle between the given direction and that in which the object rests."""


def rest_pose(
    pieces: tuple[Piece, ...],
    centroid: Float[ndarray, " 3"],
    up: Float[ndarray, " 3"],
    what: str,
) -> Float[ndarray, "4 4"]:
    """Return the pose in which an object rests on the table (z = 0) with ``up`` pointing up.

    A body rests on a face of its convex hull if its centroid is above that face. Of the faces with
    a tilt of at most 20° from ``up``, the one with the lowest centroid is chosen. The rotation is
    the smallest that puts this face on the table; the object's origin is above the table's.

    Parameters
    ----------
    pieces
        The collision shape.
    centroid
        Centre of mass, metres.
    up
        Direction in the object's frame, of any length.
    what
        The object's name in messages.

    Returns
    -------
        ``sim_T_ref``.

    Raises
    ------
    InputError
        If there is no such pose; the message lists those in which it rests.
    """
    length = float(np.linalg.norm(up))
    if not (np.isfinite(length) and length > 0):
        raise InputError(
            f"{what}: its direction up = {np.asarray(up).tolist()} is zero or not finite",
            parameters=("up",),
        )
    ups, heights = stable_ups(pieces, centroid)
    tilt = np.arccos(np.clip(ups @ (np.asarray(up) / length), -1, 1))
    near = tilt <= LARGEST_TILT_RAD
    if not near.any():
        known = ", ".join(
            f"[{', '.join(f'{x:.2f}' for x in np.round(u, 2) + 0.0)}]"
            for u in _distinct(ups, heights)
        )
        raise InputError(
            f"{what}: it does not stand with up = {[float(x) for x in up]}, it topples; it rests "
            f"with one of these up: {known}",
            parameters=("up",),
        )
    rotation = _turn_up(ups[near][np.argmin(heights[near])])
    lowest = min(_lowest(piece, rotation[2]) for piece in pieces)
    return transform(rotation, np.array([0.0, 0.0, -lowest]))


def stable_ups(
    pieces: tuple[Piece, ...], centroid: Float[ndarray, " 3"]
) -> tuple[Float[ndarray, "n 3"], Float[ndarray, " n"]]:
    """Return the direction that points up in each stable pose, and the centroid's height (metres).

    A pose is stable if the centroid is above the face on which the object rests.
    """
    from scipy.spatial import ConvexHull

    hull = ConvexHull(np.concatenate([_points(piece) for piece in pieces]))
    normal = hull.equations[:, :3]
    height = -(hull.equations[:, :3] @ centroid + hull.equations[:, 3])
    below = centroid + height[:, None] * normal
    corners = hull.points[hull.simplices]
    inside = np.ones(len(corners), dtype=bool)
    orientation = np.einsum(
        "ij,ij->i",
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
        normal,
    )
    for i in range(3):
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        side = np.einsum("ij,ij->i", np.cross(b - a, below - a), normal)
        # The edge between two triangles of one flat face belongs to both.
        inside &= side * np.sign(orientation) >= -1e-9
    return -normal[inside], height[inside]


def _distinct(ups: ndarray, heights: ndarray) -> list[ndarray]:
    """Return the stable directions, lowest centroid first, without near duplicates."""
    kept: list[ndarray] = []
    for i in np.argsort(heights):
        if all(ups[i] @ other < np.cos(LARGEST_TILT_RAD) for other in kept):
            kept.append(ups[i])
    return kept


def _turn_up(direction: Float[ndarray, " 3"]) -> Float[ndarray, "3 3"]:
    """Return the smallest rotation that maps a unit vector to +z."""
    axis = np.cross(direction, [0.0, 0.0, 1.0])
    sine, cosine = float(np.linalg.norm(axis)), float(direction[2])
    if sine < 1e-12:
        axis, sine = np.array([1.0, 0.0, 0.0]), 1.0
        return rotation_from_vector(axis * (0.0 if cosine > 0 else np.pi))
    return rotation_from_vector(axis / sine * np.arctan2(sine, cosine))


def _lowest(piece: Piece, z: Float[ndarray, " 3"]) -> float:
    """Return the exact minimum of ``z · p`` over the points of a piece (support function)."""
    if isinstance(piece, ConvexPiece):
        return float((piece.vertices @ z).min())
    along = z @ piece.obj_T_geom[:3, :3]
    size = np.array(piece.size)
    if piece.kind == "box":
        reach = float(np.abs(along) @ size)
    elif piece.kind == "cylinder":
        reach = float(np.hypot(along[0], along[1]) * size[0] + abs(along[2]) * size[1])
    else:
        reach = float(size[0])
    return float(z @ piece.obj_T_geom[:3, 3]) - reach


def _points(piece: Piece) -> Float[ndarray, "n 3"]:
    """Return points whose convex hull is the piece; circles are approximated by 64 points."""
    if isinstance(piece, ConvexPiece):
        return piece.vertices
    size = np.array(piece.size)
    if piece.kind == "box":
        grid = box_corners(size)
    else:
        angle = np.arange(64) * (2 * np.pi / 64)
        ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(64)], axis=-1) * size[0]
        if piece.kind == "cylinder":
            top = np.array([0, 0, size[1]])
            grid = np.concatenate([ring + top, ring - top])
        else:
            latitude = np.linspace(-np.pi / 2, np.pi / 2, 33)[:, None, None]
            rings = ring * np.cos(latitude) + np.array([0, 0, size[0]]) * np.sin(latitude)
            grid = rings.reshape(-1, 3)
    return transform_points(piece.obj_T_geom, grid)
