"""Simplification of large scans before they are cut into collision pieces."""

from __future__ import annotations

import logging

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

__all__ = ["MOST_FACES", "simplified"]

_log = logging.getLogger(__name__)

MOST_FACES = 200_000
"""Number of faces up to which a mesh is used as it is."""

_FIRST_CELL_M = 2e-4
_GROWTH = 1.4


def simplified(
    vertices: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"], most: int = MOST_FACES
) -> tuple[Float[ndarray, "w 3"], Int[ndarray, "g 3"]]:
    """Return a mesh of at most ``most`` faces, by merging the vertices in each cell of a grid.

    No point of the surface moves by more than the diagonal of a cell, which is logged as a
    warning. A mesh that is small enough is returned as it is.

    Parameters
    ----------
    vertices, faces
        The mesh, metres.
    most
        Number of faces.
    """
    if len(faces) <= most:
        return vertices, faces
    cell, fewer = _FIRST_CELL_M, faces
    while len(fewer) > most:
        cells = np.floor((vertices - vertices.min(axis=0)) / cell).astype(np.int64)
        sides = cells.max(axis=0) + 1
        key = (cells[:, 0] * sides[1] + cells[:, 1]) * sides[2] + cells[:, 2]
        _, number = np.unique(key, return_inverse=True)
        fewer = number.reshape(-1)[faces]
        fewer = fewer[(fewer != np.roll(fewer, 1, axis=1)).all(axis=1)]
        cell *= _GROWTH
    cell /= _GROWTH
    count = np.bincount(number)
    merged = np.stack([np.bincount(number, weights=x) / count for x in vertices.T], axis=-1)
    _log.warning(
        "the mesh has %s faces; for collision it is simplified to %s, off by at most %.2g mm",
        f"{len(faces):,}",
        f"{len(fewer):,}",
        1000 * cell * np.sqrt(3),
    )
    return merged, fewer
