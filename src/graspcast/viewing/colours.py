"""Colours of scenes: estimators by name, probabilities from dark to bright."""

from __future__ import annotations

import numpy as np

__all__ = [
    "ELLIPSOID",
    "ESTIMATORS",
    "FUSED",
    "RGB",
    "UNKNOWN",
    "of_probability",
    "probability_legend",
]

RGB = tuple[int, int, int]
"""Red, green and blue, each from 0 to 255."""

ESTIMATORS: tuple[RGB, ...] = (
    (0, 158, 115),
    (230, 159, 0),
    (86, 180, 233),
    (204, 121, 167),
    (213, 94, 0),
    (240, 228, 66),
)
"""Colours of estimators in their order, which can be told apart with impaired colour vision.

They are those of Okabe and Ito, *Color Universal Design* (2008).
"""

FUSED: RGB = (0, 90, 220)
"""The fused pose."""

ELLIPSOID: RGB = (230, 30, 60)
"""The ellipsoid of a position."""

UNKNOWN: RGB = (140, 140, 140)
"""A grasp without a probability."""

# Matplotlib's viridis at 0, 1/4, ..., 1.
_VIRIDIS = np.array([(68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37)])


def of_probability(probability: float | None) -> RGB:
    """Return the colour of a probability, from dark violet at 0 to yellow at 1; grey for None."""
    if probability is None or not 0 <= probability <= 1:
        return UNKNOWN
    stops = np.linspace(0, 1, len(_VIRIDIS))
    r, g, b = (round(float(np.interp(probability, stops, channel))) for channel in _VIRIDIS.T)
    return r, g, b


def probability_legend() -> tuple[tuple[str, RGB], ...]:
    """Return probabilities in words with their colours."""
    shares = np.linspace(0, 1, len(_VIRIDIS)).tolist()
    return tuple((f"grasp succeeds with probability {p:g}", of_probability(p)) for p in shares)
