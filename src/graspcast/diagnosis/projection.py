"""Projection of models by poses, to be compared with bounding boxes in images."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.models_writing import extreme_points
from graspcast.errors import GraspcastError
from graspcast.pose.transforms import transform_points

__all__ = ["Fit", "Seen", "fit_camera", "outline_points", "spread"]

_ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Seen:
    """Boxes of instances, and the projections of their models.

    Attributes
    ----------
    obj_id
        Objects, (n,).
    rays
        Edges of the projected model at depth 1, without a camera: left, top, right, bottom, (n, 4).
    box
        Edges of the box in pixels: left, top, right, bottom, (n, 4).
    K
        Cameras, (n, 3, 3).
    """

    obj_id: ndarray
    rays: Float[ndarray, "n 4"]
    box: Float[ndarray, "n 4"]
    K: Float[ndarray, "n 3 3"]

    def __len__(self) -> int:
        return len(self.obj_id)

    def edges(self) -> Float[ndarray, "n 4"]:
        """Return the edges in pixels by the cameras."""
        focal = self.K[:, [0, 1, 0, 1], [0, 1, 0, 1]]
        middle = self.K[:, [0, 1, 0, 1], [2, 2, 2, 2]]
        return self.rays * focal + middle

    def sizes(self) -> Float[ndarray, " n"]:
        """Return the longer side of each box, pixels."""
        return np.asarray(np.maximum(*(self.box[:, 2:] - self.box[:, :2]).T))


@cache
def outline_points(models: Models, obj_id: int) -> Float[ndarray, "v 3"] | None:
    """Return the points of an object that can be its outline, None without a readable mesh."""
    try:
        return extreme_points(models.mesh(obj_id).vertices)
    except GraspcastError:
        return None


def rays_of(points: Float[ndarray, "v 3"], poses: Float[ndarray, "n 4 4"]) -> ndarray:
    """Return the edges of projected points at depth 1: left, top, right, bottom, (n, 4)."""
    seen = transform_points(poses, points)
    depth = seen[..., 2:]
    flat = np.where(depth > 1e-6, seen[..., :2] / np.where(depth > 1e-6, depth, 1.0), np.nan)
    return np.concatenate([flat.min(axis=1), flat.max(axis=1)], axis=1)


def spread(edges: Float[ndarray, "n 4"], seen: Seen, box: ndarray | None = None) -> float:
    """Return the median distance of edges from those of boxes, by the boxes' longer sides."""
    box = seen.box if box is None else box
    sides = np.maximum(*(box[:, 2:] - box[:, :2]).T)
    good = sides > 0
    if not good.any():
        return float("inf")
    apart = np.abs(edges[good] - box[good]) / sides[good, None]
    return float(np.median(apart.max(axis=1)))


@dataclass(frozen=True)
class Fit:
    """A pinhole camera fitted to boxes and projections: focal lengths and principal point."""

    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def K(self) -> Float[ndarray, "3 3"]:
        """The camera as a matrix."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])


def fit_camera(seen: Seen) -> Fit:
    """Fit a camera to boxes: least absolute distances of edges (reweighted least squares)."""
    found = []
    for axis in (0, 1):
        x = np.concatenate([seen.rays[:, axis], seen.rays[:, axis + 2]])
        y = np.concatenate([seen.box[:, axis], seen.box[:, axis + 2]])
        weight = np.ones(len(x))
        slope, middle = 1.0, 0.0
        for _ in range(_ROUNDS):
            mean_x, mean_y = np.average(x, weights=weight), np.average(y, weights=weight)
            slope = float(
                (weight * (x - mean_x) * (y - mean_y)).sum()
                / max(float((weight * (x - mean_x) ** 2).sum()), 1e-12)
            )
            middle = float(mean_y - slope * mean_x)
            weight = 1 / np.maximum(np.abs(y - slope * x - middle), 0.5)
        found.append((slope, middle))
    (fx, cx), (fy, cy) = found
    return Fit(fx, fy, cx, cy)
