"""Frames of meshes: how two files of one object differ in shape, place and orientation."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.meshes import Mesh
from graspcast.pose.lengths import METRES, UNIT_NAMES, shown
from graspcast.pose.transforms import rotation_angle, rotation_vector
from graspcast.simulation.objects.surface import Surface

__all__ = ["frame_difference"]

_SAME = 0.01
_ALIKE = 0.02


def frame_difference(mine: Mesh, other: Mesh) -> str:
    """Say how two meshes of one object differ.

    Parameters
    ----------
    mine, other
        The meshes, metres.

    Returns
    -------
        Empty if they have the same shape in the same frame, to 1 % of the size. Otherwise a clause
        about the first: ``"the same shape, moved by (0, 0, 51) mm"``.
    """
    first, second = Surface(mine.vertices, mine.faces), Surface(other.vertices, other.faces)
    size = second.diameter_m
    ratio = first.diameter_m / size
    if not 0.9 <= ratio <= 1.1:
        said = f"{shown(first.diameter_m)} across, not {shown(size)}"
        for unit, read in permutations(METRES, 2):
            if 0.97 <= ratio * METRES[unit] / METRES[read] <= 1.03:
                return f"{said}; is it in {UNIT_NAMES[unit]}, not in {UNIT_NAMES[read]}?"
        return said
    if _nearly(first, second, np.eye(3), np.zeros(3)) <= _SAME * size:
        return ""
    found = []
    for rotation in _rotations(first, second):
        moved = second.centroid - rotation @ first.centroid
        found.append((_nearly(first, second, rotation, moved), rotation, moved))
    best = min(apart for apart, _, _ in found)
    if best > _ALIKE * size:
        return f"another shape (up to {shown(best)} apart in the best of {len(found)} poses)"
    near = [f for f in found if f[0] <= 1.5 * best + 1e-3 * size]
    _, rotation, moved = min(near, key=lambda f: float(rotation_angle(f[1])))
    # The motion that takes the second to the first.
    return f"the same shape, {_motion(rotation.T, -rotation.T @ moved)}"


def _nearly(first: Surface, second: Surface, rotation: ndarray, moved: ndarray) -> float:
    """Return the distance that 98 % of each surface, the first one moved, keeps from the other."""
    there = second.distances(first.by_area[::6] @ rotation.T + moved)
    back = first.distances((second.by_area[::6] - moved) @ rotation)
    return float(max(np.quantile(there, 0.98), np.quantile(back, 0.98)))


def _rotations(first: Surface, second: Surface) -> list[Float[ndarray, "3 3"]]:
    """Return rotations between coordinate axes, and between the principal axes of the surfaces."""
    signed = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    proper = [matrix for matrix in signed if np.linalg.det(matrix) > 0]
    axes = [np.linalg.eigh(surface.moments)[1] for surface in (first, second)]
    between = [axes[1] @ matrix @ axes[0].T for matrix in signed]
    return proper + [matrix for matrix in between if np.linalg.det(matrix) > 0]


def _motion(rotation: ndarray, moved: ndarray) -> str:
    vector = rotation_vector(rotation)
    angle = float(np.linalg.norm(vector))
    parts = []
    if angle > np.deg2rad(0.5):
        axis = ", ".join(f"{x:.3g}" for x in np.round(vector / angle, 3) + 0.0)
        parts.append(f"turned by {np.rad2deg(angle):.3g}° about ({axis})")
    x, y, z = np.round(1000 * moved, 1) + 0.0
    if np.abs(moved).max() > 1e-4:
        parts.append(f"moved by ({x:g}, {y:g}, {z:g}) mm")
    return " and ".join(parts) or "in another place"
