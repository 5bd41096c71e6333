"""Colours of a mesh file: of its vertices, faces or texture, at the vertices of the mesh."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from graspcast.bop.meshes import Mesh, load_with_colours
from graspcast.errors import FormatError
from graspcast.pose.lengths import METRES

__all__ = ["read_colours"]


def read_colours(path: Path, mesh: Mesh, unit: str) -> UInt8[ndarray, "v 3"] | None:
    """Read the colours of a file at the vertices of the mesh that was read from it.

    Vertices that the file repeats, as along the seams of a texture, are one in the mesh, which has
    the colour of one of them.

    Parameters
    ----------
    path
        The file.
    mesh
        Its mesh, metres.
    unit
        The unit in which it was read.

    Returns
    -------
    RGB, 0 to 255, for each vertex of the mesh; None if the file has no colours.
    """
    from scipy.spatial import cKDTree

    if path.suffix.lower() == ".stl":
        return None
    try:
        with warnings.catch_warnings():
            # trimesh and NumPy warn about files that the reader of shapes has accepted.
            warnings.simplefilter("ignore")
            loaded, colours = load_with_colours(path, path.suffix[1:].lower(), force="mesh")
    except FormatError:
        # Its shape was read; what is wrong is in its materials.
        return None
    if colours is None:
        return None
    vertices = np.array(loaded.vertices, dtype=np.float64) * METRES[unit]
    finite = np.isfinite(vertices).all(axis=1)
    nearest = cKDTree(vertices[finite]).query(mesh.vertices)[1]
    found: ndarray = np.ascontiguousarray(colours[finite][nearest])
    return found
