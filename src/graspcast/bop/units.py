"""Conversion between millimetres, in BOP's files, and metres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

__all__ = ["metres", "millimetres"]


def metres(length_mm: Float[ndarray, "..."]) -> Float[ndarray, "..."]:
    """Convert millimetres to metres."""
    return np.divide(length_mm, 1000.0, out=np.empty(np.shape(length_mm)))


def millimetres(length_m: Float[ndarray, "..."]) -> Float[ndarray, "..."]:
    """Convert metres to millimetres so that :func:`metres` returns exactly the same numbers.

    The product with 1000 is rounded, and its quotient by 1000 may be another number than the one
    before; then the neighbouring float is used if its quotient is exact.
    """
    out: ndarray = np.multiply(length_m, 1000.0, out=np.empty(np.shape(length_m)))
    for direction in (-np.inf, np.inf):
        neighbour = np.asarray(np.nextafter(out, direction))
        exact = (metres(out) != length_m) & (metres(neighbour) == length_m)
        out = np.where(exact, neighbour, out)
    return out
