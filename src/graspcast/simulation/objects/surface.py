"""Surface of a mesh: points on it, their distances from it after a motion, and its moments."""

from __future__ import annotations

from functools import cached_property
from typing import Any, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models_writing import diameter, extreme_points
from graspcast.io.compiling import cached_njit

__all__ = ["Surface"]

_SAMPLES = 20_000
_TESTED, _TESTED_FACES, _TESTED_CORNERS = 3000, 1000, 300
_MOST_CENTRES = 100_000
_NEIGHBOURS, _MORE_NEIGHBOURS = 5, 60
_NEAR = 1e-4


class Surface:
    """The surface of a triangle mesh, to be compared with itself or another after a motion.

    Distances are exact to the triangles of the nearest of many points on the surface, which are
    samples by area and the middles of faces, so that neither a large nor a small triangle is
    overlooked. The same mesh always gives the same numbers.

    Parameters
    ----------
    vertices, faces
        The mesh, metres.
    """

    def __init__(self, vertices: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"]):
        self._vertices = vertices
        corners = vertices[faces]
        doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(doubled, axis=1) / 2
        self.triangles: ndarray = corners[area > 0]
        self.area: ndarray = area[area > 0]
        self.samples, self._sampled = self._sample(_SAMPLES)

    def _sample(self, count: int) -> tuple[ndarray, ndarray]:
        """Return points evenly spread by area, and the triangle of each."""
        rng = np.random.default_rng(0)
        ends = np.cumsum(self.area)
        at = (np.arange(count) + rng.random(count)) * (ends[-1] / count)
        number = np.minimum(np.searchsorted(ends, at), len(ends) - 1)
        u, v = rng.random((2, count, 1))
        fold = u + v > 1
        u, v = np.where(fold, 1 - u, u), np.where(fold, 1 - v, v)
        a, b, c = np.moveaxis(self.triangles[number], 1, 0)
        return a + u * (b - a) + v * (c - a), number

    @cached_property
    def centroid(self) -> Float[ndarray, " 3"]:
        """Middle of the surface: the mean of its points, metres; symmetries leave it in place."""
        middle: ndarray = self.area @ self.triangles.mean(axis=1) / self.area.sum()
        return middle

    @cached_property
    def moments(self) -> Float[ndarray, "3 3"]:
        """Second moments of the surface about its centroid, m^2; symmetries commute with them."""
        corners = self.triangles - self.centroid
        middle = corners.mean(axis=1)
        within = np.einsum("f,fki,fkj->ij", self.area, corners, corners)
        between = 9 * np.einsum("f,fi,fj->ij", self.area, middle, middle)
        moments: ndarray = (within + between) / (12 * self.area.sum())
        return moments

    @cached_property
    def diameter_m(self) -> float:
        """Largest distance of two corners of the convex hull, metres."""
        return diameter(self.corners)

    @cached_property
    def width_m(self) -> float:
        """Extent along the second of the principal axes, metres: that of a knife is its width."""
        _, axes = np.linalg.eigh(self.moments)
        return float(np.sort(np.ptp(self.corners @ axes, axis=0))[1])

    @cached_property
    def corners(self) -> Float[ndarray, "h 3"]:
        """Corners of the convex hull."""
        from scipy.spatial import ConvexHull

        points = extreme_points(self._vertices)
        hull: ndarray = points[ConvexHull(points).vertices]
        return hull

    @cached_property
    def by_area(self) -> Float[ndarray, "n 3"]:
        """Points spread evenly by area, by which shares of the surface are counted."""
        return self.samples[:: _SAMPLES // _TESTED]

    @cached_property
    def details(self) -> Float[ndarray, "n 3"]:
        """Middles of faces, of which small features have many, and corners of the hull."""
        centres = self._centres(_TESTED_FACES)[0]
        step = max(1, len(self.corners) // _TESTED_CORNERS)
        return np.concatenate([centres, self.corners[::step]])

    def _centres(self, most: int) -> tuple[ndarray, ndarray]:
        number = np.arange(0, len(self.triangles), max(1, len(self.triangles) // most))
        return self.triangles[number].mean(axis=1), number

    @cached_property
    def _index(self) -> tuple[Any, ndarray]:
        from scipy.spatial import cKDTree

        centres, number = self._centres(_MOST_CENTRES)
        return (
            cKDTree(np.concatenate([self.samples, centres])),
            np.concatenate([self._sampled, number]),
        )

    def distances(self, points: Float[ndarray, "n 3"]) -> Float[ndarray, " n"]:
        """Return the distances of points from the surface, metres.

        Where the triangles of few nearest samples are not near, those of more are looked at.
        """
        apart = self.quickly(points, _NEIGHBOURS)
        far = apart > _NEAR * self.diameter_m
        if far.any():
            apart[far] = self.quickly(points[far], _MORE_NEIGHBOURS)
        return apart

    def quickly(self, points: Float[ndarray, "n 3"], neighbours: int = 3) -> Float[ndarray, " n"]:
        """Return the distances of points from the triangles of the nearest samples, metres."""
        tree, number = self._index
        _, nearest = tree.query(points, k=neighbours)
        out = np.empty(len(points))
        _nearest(np.ascontiguousarray(points), self.triangles, number[nearest], out)
        return out

    def outside(self, points: Float[ndarray, "n 3"]) -> Bool[ndarray, " n"]:
        """Return which points are on the outer side of the nearest sample's triangle."""
        tree, number = self._index
        _, nearest = tree.query(points)
        a, b, c = np.moveaxis(self.triangles[number[nearest]], 1, 0)
        side = np.einsum("ij,ij->i", np.cross(b - a, c - a), points - tree.data[nearest])
        outer: ndarray = side > 0
        return outer

    def roughly(self, points: Float[ndarray, "*batch 3"]) -> Float[ndarray, "*batch"]:
        """Return the distances of points from the nearest sample, metres: quick, and too large."""
        apart: ndarray = self._index[0].query(points)[0]
        return apart


@no_type_check
@cached_njit()
def _nearest(points, triangles, candidates, out):
    """Compute the distance of each point from the nearest of its candidate triangles.

    After Ericson, Real-Time Collision Detection, Section 5.1.5.
    """
    for i in range(len(points)):
        least = np.inf
        for k in range(candidates.shape[1]):
            least = min(least, _squared(points[i], triangles[candidates[i, k]]))
        out[i] = np.sqrt(least)


@no_type_check
@cached_njit()
def _squared(point, corners):
    """Return the squared distance of a point from a triangle."""
    d1 = d2 = d3 = aa = bb = cc = pp = 0.0
    for k in range(3):
        u, v = corners[1, k] - corners[0, k], corners[2, k] - corners[0, k]
        p = point[k] - corners[0, k]
        aa, bb, cc, pp = aa + u * u, bb + u * v, cc + v * v, pp + p * p
        d1, d2 = d1 + u * p, d2 + v * p
        d3 += (p - u) * (v - u)
    v, w = cc * d1 - bb * d2, aa * d2 - bb * d1
    area = aa * cc - bb * bb
    if v >= 0 and w >= 0 and v + w <= area and area > 0:
        v, w = v / area, w / area
        return max(pp - 2 * (v * d1 + w * d2) + v * v * aa + 2 * v * w * bb + w * w * cc, 0.0)
    # Outside of the prism above the triangle, the nearest point lies on an edge.
    s, t, r = _share(d1, aa), _share(d2, cc), _share(d3, aa - 2 * bb + cc)
    first = pp - 2 * s * d1 + s * s * aa
    second = pp - 2 * t * d2 + t * t * cc
    third = pp - 2 * d1 + aa - 2 * r * d3 + r * r * (aa - 2 * bb + cc)
    return max(min(first, second, third), 0.0)


@no_type_check
@cached_njit()
def _share(along, squared):
    """Return where on an edge the foot of a perpendicular lies, from 0 to 1."""
    return min(max(along / squared, 0.0), 1.0) if squared > 0 else 0.0
