"""Finite groups of rotations from a few of their elements, which are known only nearly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import project_to_rotation, rotation_angle

__all__ = ["closed_group"]

_MOST = 120
_ROUNDS = 20


def closed_group(
    rotations: Sequence[Float[ndarray, "3 3"]], spacing_rad: float
) -> Float[ndarray, "g 3 3"] | None:
    """Return the group that rotations generate, the identity first, made exact.

    Parameters
    ----------
    rotations
        Its generators, each of which may be off by some degrees.
    spacing_rad
        Angle below which two products are the same element, radians.

    Returns
    -------
        The group, or None if there is no finite one of at most 120 rotations.
    """
    group = [np.eye(3)]
    for rotation in rotations:
        if _find(np.array(group), rotation, spacing_rad) is None:
            group.append(rotation)
    done = 0
    while done < len(group):
        for other in range(len(group)):
            for i, j in ((done, other), (other, done)):
                product = group[i] @ group[j]
                if _find(np.array(group), product, spacing_rad) is None:
                    group.append(product)
                    if len(group) > _MOST:
                        return None
        done += 1
    return _made_exact(np.array(group), spacing_rad)


def _find(group: ndarray, rotation: ndarray, spacing_rad: float) -> int | None:
    angles = np.atleast_1d(rotation_angle(np.swapaxes(group, -1, -2) @ rotation))
    nearest = int(np.argmin(angles))
    return nearest if angles[nearest] < spacing_rad else None


def _made_exact(group: ndarray, spacing_rad: float) -> ndarray | None:
    """Replace each element by the mean of products that should be equal to it, repeatedly."""
    count = len(group)
    table = np.empty((count, count), dtype=np.int64)
    for i in range(count):
        for j in range(count):
            found = _find(group, group[i] @ group[j], spacing_rad)
            if found is None:
                return None
            table[i, j] = found
    if any(len(set(row)) < count for row in (*table, *table.T)):
        return None
    for _ in range(_ROUNDS):
        # The mean over h of (gh) h^-1, which is g: the errors that remain are of second order.
        total = np.einsum("ghij,hkj->gik", group[table], group)
        group = project_to_rotation(total)
        if np.abs(group[table] - np.einsum("aij,bjk->abik", group, group)).max() < 1e-12:
            break
    group[0] = np.eye(3)
    return group
