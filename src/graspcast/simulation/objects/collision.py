"""Collision shape of a new object: which pieces it gets, and how far they stick out of the mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy import ndarray

from graspcast.bop.meshes import Mesh
from graspcast.io.wording import counted
from graspcast.pose.lengths import shown
from graspcast.simulation.objects.decomposition import Decomposition, convex_hull, decompose
from graspcast.simulation.objects.surface import Surface
from graspcast.simulation.objects.types import ConvexPiece

__all__ = ["CollisionShape", "choose_collision", "sticks_out"]

_CONVEX_M, _CONVEX_SHARE = 5e-4, 0.01
_POINTS = 1000
_TOUCHING_M = 1e-5


@dataclass(frozen=True, eq=False)
class CollisionShape:
    """Convex pieces of an object, with how they were made.

    Attributes
    ----------
    how
        The parameters of the decomposition.
    pieces
        The pieces.
    sticks_out_m
        How far they stick out of the mesh, where they fill a hollow or make a wall thicker, metres.
    """

    how: Decomposition
    pieces: tuple[ConvexPiece, ...]
    sticks_out_m: float

    def __str__(self) -> str:
        """Return it in words: ``"8 pieces, up to 4.1 mm outside"``."""
        count = counted(len(self.pieces), "piece")
        if self.sticks_out_m < 1e-4:
            return count
        return f"{count}, up to {shown(self.sticks_out_m)} outside"


def choose_collision(
    mesh: Mesh, surface: Surface, *, closed: bool, pieces: int | None = None
) -> CollisionShape:
    """Decompose the mesh of a new object.

    A convex object is its own hull. A closed mesh is cut as it is, so that a thin wall stays as
    thin as it is. A mesh that is not closed is closed first, which makes thin walls thicker.

    Parameters
    ----------
    mesh, surface
        The mesh.
    closed
        Whether it is closed.
    pieces
        Largest number of pieces; by default one for a convex object, else 8.
    """
    if pieces in (None, 1):
        hull = Decomposition(pieces=1)
        piece = (convex_hull(mesh.vertices, hull.hull_tolerance_m),)
        out = sticks_out(piece, surface)
        if pieces == 1 or out <= _CONVEX_M + _CONVEX_SHARE * surface.diameter_m:
            return CollisionShape(hull, decompose(mesh.vertices, mesh.faces, hull), out)
    how = Decomposition(preprocess=not closed, **({} if pieces is None else {"pieces": pieces}))
    found = decompose(mesh.vertices, mesh.faces, how)
    return CollisionShape(how, found, sticks_out(found, surface))


def sticks_out(pieces: Sequence[ConvexPiece], surface: Surface) -> float:
    """Measure how far convex pieces stick out of a mesh, metres.

    Points on the outside of the pieces are compared with the surface; those behind it, as seen
    from the nearest triangle, do not count.
    """
    farthest = 0.0
    for piece in pieces:
        points = Surface(piece.vertices, piece.faces).samples[:: 20_000 // _POINTS]
        points = np.concatenate([points, piece.vertices])
        for other in pieces:
            if other is not piece:
                points = points[~_inside(points, other)]
        if len(points):
            apart = surface.distances(points)
            farthest = max(farthest, float(apart[surface.outside(points)].max(initial=0.0)))
    return farthest


def _inside(points: ndarray, piece: ConvexPiece) -> ndarray:
    corners = piece.vertices[piece.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
    above = points @ normal.T - np.einsum("ij,ij->i", normal, corners[:, 0])
    inside: ndarray = (above < _TOUCHING_M).all(axis=1)
    return inside
