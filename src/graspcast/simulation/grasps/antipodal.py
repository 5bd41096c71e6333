"""Antipodal pairs: pairs of points of a mesh between which two jaws can close without slipping.

Rays start at points of the surface, run into the object within the friction cone about the inward
normal, and leave it again where they first or last cross the surface: at the other side of a wall,
or of the whole object. A pair is antipodal if the line between the points lies in both friction
cones (Nguyen, *Constructing Force-Closure Grasps*, 1988).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.io.compiling import cached_njit
from graspcast.simulation.objects.types import GraspObject

__all__ = ["ContactPairs", "contact_pairs", "points_on_faces"]

_STEP_IN_M = 1e-5


@dataclass(frozen=True, eq=False)
class ContactPairs:
    """Pairs of points of a surface with the object, or a wall of it, between them.

    Attributes
    ----------
    first, second
        The points, in the object's frame, metres.
    slope
        The larger of the tangents of the angles between the line that joins the points and the two
        normals; the fingers slip where friction is lower.
    """

    first: Float[ndarray, "n 3"]
    second: Float[ndarray, "n 3"]
    slope: Float[ndarray, " n"]

    @property
    def width_m(self) -> Float[ndarray, " n"]:
        """Distances of the points, metres."""
        return np.linalg.norm(self.second - self.first, axis=1)

    def chosen(self, rows: Bool[ndarray, " n"] | Int[ndarray, " k"]) -> ContactPairs:
        """Return some of the pairs."""
        return ContactPairs(self.first[rows], self.second[rows], self.slope[rows])


def points_on_faces(
    grasp_object: GraspObject, count: int, rng: np.random.Generator
) -> tuple[Float[ndarray, "p 3"], Int[ndarray, " p"]]:
    """Sample points on the mesh uniformly by area, and return the face of each as well."""
    corners = grasp_object.vertices[grasp_object.faces]
    edges = corners[:, 1:] - corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    face = rng.choice(len(area), size=count, p=area / area.sum())
    u, v = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - u, u * (1 - v), u * v], axis=1)
    return np.einsum("pk,pkj->pj", weights, corners[face]), face


def contact_pairs(grasp_object: GraspObject, count: int, rng: np.random.Generator) -> ContactPairs:
    """Find pairs of points by ``count`` rays through the mesh; at most two for each ray.

    The slope of a pair may exceed the friction: such a pair says how slippery the object is.

    Parameters
    ----------
    grasp_object
        The object, with its friction; its mesh is closed and its normals point outwards.
    count
        Number of rays.
    rng
        Random generator.
    """
    triangles = np.ascontiguousarray(grasp_object.vertices[grasp_object.faces])
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-15)
    start, face = points_on_faces(grasp_object, count, rng)
    outward = normals[face]
    direction = _within_cone(-outward, grasp_object.friction, rng)
    nearest, farthest = np.empty(count), np.empty(count)
    faces = np.empty((count, 2), dtype=np.int64)
    _cast(start + _STEP_IN_M * direction, direction, triangles, nearest, farthest, faces)
    found = []
    for distance, last in ((nearest, False), (farthest, True)):
        there = np.isfinite(distance) & (distance > 0)
        if last:
            there &= farthest > nearest + 1e-4
        along = direction[there]
        other = normals[faces[there, int(last)]]
        cosine = np.minimum(
            -np.einsum("ij,ij->i", along, outward[there]), np.einsum("ij,ij->i", along, other)
        )
        facing = cosine > 1e-3
        end = start[there] + along * (distance[there] + _STEP_IN_M)[:, None]
        slope = np.sqrt(np.maximum(0.0, 1 / np.maximum(cosine, 1e-3) ** 2 - 1))
        found.append(ContactPairs(start[there][facing], end[facing], slope[facing]))
    return ContactPairs(
        np.concatenate([pairs.first for pairs in found]),
        np.concatenate([pairs.second for pairs in found]),
        np.concatenate([pairs.slope for pairs in found]),
    )


def _within_cone(
    axis: Float[ndarray, "n 3"], friction: float, rng: np.random.Generator
) -> Float[ndarray, "n 3"]:
    """Return unit vectors in the friction cones about axes; a third of them along the axes."""
    count = len(axis)
    aside = np.cross(axis, np.eye(3)[np.abs(axis).argmin(axis=1)])
    aside /= np.linalg.norm(aside, axis=1, keepdims=True)
    other = np.cross(axis, aside)
    angle = rng.uniform(0, 2 * np.pi, (count, 1))
    tangent = friction * np.sqrt(rng.random((count, 1))) * (rng.random((count, 1)) > 1 / 3)
    vector = axis + tangent * (np.cos(angle) * aside + np.sin(angle) * other)
    unit: ndarray = vector / np.linalg.norm(vector, axis=1, keepdims=True)
    return unit


@no_type_check
@cached_njit(nogil=True)
def _cast(starts, directions, triangles, nearest, farthest, faces):
    """Find the nearest and the farthest triangle that each ray leaves through (Möller-Trumbore)."""
    for i in range(len(starts)):
        nearest[i], farthest[i] = np.inf, -np.inf
        faces[i, 0] = faces[i, 1] = 0
        ox, oy, oz = starts[i, 0], starts[i, 1], starts[i, 2]
        dx, dy, dz = directions[i, 0], directions[i, 1], directions[i, 2]
        for k in range(len(triangles)):
            t = triangles[k]
            ax, ay, az = t[1, 0] - t[0, 0], t[1, 1] - t[0, 1], t[1, 2] - t[0, 2]
            bx, by, bz = t[2, 0] - t[0, 0], t[2, 1] - t[0, 1], t[2, 2] - t[0, 2]
            px, py, pz = dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx
            # Positive where the ray enters: only where it leaves is a finger's place.
            volume = ax * px + ay * py + az * pz
            if volume > -1e-18:
                continue
            sx, sy, sz = ox - t[0, 0], oy - t[0, 1], oz - t[0, 2]
            u = (sx * px + sy * py + sz * pz) / volume
            if u < 0.0 or u > 1.0:
                continue
            qx, qy, qz = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
            v = (dx * qx + dy * qy + dz * qz) / volume
            if v < 0.0 or u + v > 1.0:
                continue
            distance = (bx * qx + by * qy + bz * qz) / volume
            if distance <= 0.0:
                continue
            if distance < nearest[i]:
                nearest[i] = distance
                faces[i, 0] = k
            if distance > farthest[i]:
                farthest[i] = distance
                faces[i, 1] = k
