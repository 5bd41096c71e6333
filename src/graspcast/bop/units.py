"""The one place where millimetres meet metres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

__all__ = ["metres", "millimetres"]


def metres(length_mm: Float[ndarray, "..."]) -> Float[ndarray, "..."]:
    """Millimetres to metres."""
    return np.divide(length_mm, 1000.0, out=np.empty(np.shape(length_mm)))


def millimetres(length_m: Float[ndarray, "..."]) -> Float[ndarray, "..."]:
    """Metres to millimetres, such that :func:`metres` gives the very same number back.

    A product with 1000 is rounded, so the nearest product is not always the one whose quotient
    is the number we started from; where it is not, a neighbour is taken if that is exact.
    """
    out: ndarray = np.multiply(length_m, 1000.0, out=np.empty(np.shape(length_m)))
    for direction in (-np.inf, np.inf):
        neighbour = np.nextafter(out, direction)
        exact = (metres(out) != length_m) & (metres(neighbour) == length_m)
        out = np.where(exact, neighbour, out)
    return out
