"""Geometry of the trained objects as tensors: boxes, diameters, keypoints, points, symmetries."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import torch
from numpy import ndarray
from torch import Tensor

from graspcast.rendering.synthetic.tabletop import ColouredMesh
from graspcast.training.networks import KEYPOINTS
from graspcast.training.objects import Objects

__all__ = ["Geometry", "farthest_points"]

_MOST_SYMMETRIES = 12
_POINTS = 48
_FEWEST_VERTICES = 400


@dataclass
class Geometry:
    """Geometry of the objects as tensors, in the order of their ids.

    Attributes
    ----------
    low, size
        Minimum corner and sides of the bounding box, metres, (o, 3).
    diameter
        Diameter, metres, (o,).
    keypoints
        Farthest-point samples of the surface, metres, (o, KEYPOINTS, 3).
    points
        Points on the surface, metres, (o, _POINTS, 3).
    symmetries
        Symmetry transforms, (o, s, 4, 4), the identity first and as padding; at most 12.
    """

    low: Tensor
    size: Tensor
    diameter: Tensor
    keypoints: Tensor
    points: Tensor
    symmetries: Tensor

    def to(self, device: str) -> Geometry:
        """Return the geometry on a device."""
        return Geometry(**{f.name: getattr(self, f.name).to(device) for f in fields(self)})

    @classmethod
    def of(cls, objects: Objects) -> Geometry:
        """Return the geometry of objects, on the CPU."""
        infos = [objects.models[k] for k in objects.ids]
        count = min(_MOST_SYMMETRIES, max(len(i.symmetries) for i in infos))
        symmetries = np.tile(np.eye(4), (len(infos), count, 1, 1))
        for k, info in enumerate(infos):
            every = -(-len(info.symmetries) // count)
            chosen = info.symmetries[::every]
            symmetries[k, : len(chosen)] = chosen
        spread = [farthest_points(_surface_points(objects.meshes[k]), _POINTS) for k in objects.ids]

        def tensor(values: object) -> Tensor:
            return torch.from_numpy(np.array(values)).float()

        return cls(
            low=tensor([i.lower for i in infos]),
            size=tensor([i.size for i in infos]),
            diameter=tensor([i.diameter_m for i in infos]),
            keypoints=tensor([p[:KEYPOINTS] for p in spread]),
            points=tensor(spread),
            symmetries=tensor(symmetries),
        )


def _surface_points(mesh: ColouredMesh) -> ndarray:
    """Return the vertices of a mesh; those of a coarse one are made more by dividing triangles."""
    import trimesh

    divide: Any = trimesh.remesh.subdivide
    vertices, faces = mesh.vertices, mesh.faces
    while len(faces) and len(vertices) < _FEWEST_VERTICES:
        vertices, faces = divide(vertices, faces)
    return vertices


def farthest_points(vertices: ndarray, count: int) -> ndarray:
    """Farthest-point sampling; the first point is the farthest from the box's centre."""
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    distance = np.linalg.norm(vertices - middle, axis=1)
    chosen = [int(np.argmax(distance))]
    distance = np.full(len(vertices), np.inf)
    for _ in range(count - 1):
        distance = np.minimum(distance, np.linalg.norm(vertices - vertices[chosen[-1]], axis=1))
        chosen.append(int(np.argmax(distance)))
    return vertices[chosen]
