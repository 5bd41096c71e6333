"""Bodies of a mesh: the closed parts that share no vertex, and whether they are one object."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from graspcast.bop.meshes import Mesh
from graspcast.errors import InputError
from graspcast.pose.lengths import shown
from graspcast.simulation.objects.surface import Surface

__all__ = ["bodies_of", "check_bodies"]

_APART = 0.02
_LOOKED_AT = 20


def bodies_of(mesh: Mesh) -> Int[ndarray, " f"]:
    """Return the number of the body that each face belongs to, the largest body first."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    count, faces = len(mesh.vertices), mesh.faces
    ends = (faces[:, [0, 1]].reshape(-1), faces[:, [1, 2]].reshape(-1))
    edges = coo_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(count, count))
    _, label = connected_components(edges, directed=False)
    _, body = np.unique(label[faces[:, 0]], return_inverse=True)
    corners = mesh.vertices[faces]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.bincount(body.reshape(-1), weights=np.linalg.norm(doubled, axis=1))
    rank = np.empty(len(area), dtype=np.int64)
    rank[np.argsort(-area, kind="stable")] = np.arange(len(area))
    ranked: ndarray = rank[body.reshape(-1)]
    return ranked


def check_bodies(what: str, mesh: Mesh) -> str:
    """Check that the bodies of a mesh are one object: that none lies apart from the largest.

    Returns
    -------
        A remark if there are several; empty if there is one.

    Raises
    ------
    InputError
        If a body is apart by more than 2 % of the object's size; with both sizes and the gap.
    """
    body = bodies_of(mesh)
    count = int(body.max()) + 1
    if count == 1:
        return ""
    parts = [mesh.faces[body == k] for k in range(min(count, _LOOKED_AT))]
    largest = mesh.vertices[np.unique(parts[0])]
    low, high = largest.min(axis=0), largest.max(axis=0)
    surface = Surface(mesh.vertices, parts[0])
    size = float(np.ptp(mesh.vertices, axis=0).max())
    for part in parts[1:]:
        points = mesh.vertices[np.unique(part)]
        gap = 0.0
        if (points < low).any() or (points > high).any():
            tried = np.concatenate([points, Surface(mesh.vertices, part).by_area])
            # Near an edge of the largest body a sample may be nearest that faces another way.
            if surface.outside(tried).mean() > 0.5:
                gap = float(surface.distances(tried).min())
        if gap > _APART * size:
            across, main = (float(np.ptp(p, axis=0).max()) for p in (points, largest))
            raise InputError(
                f"{what}: it has {count} bodies, and one of {shown(across)} lies {shown(gap)} "
                f"apart from the largest of {shown(main)}; is it a scene, or a speck of a scan? "
                "Keep one rigid object in the file"
            )
    return f"{what}: it has {count} bodies; where they overlap, volume and mass count twice"
