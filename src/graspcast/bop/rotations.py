"""Rotation matrices from files, which are rounded and sometimes wrong."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.sanity import MAX_ROTATION_DEVIATION
from graspcast.pose.transforms import project_to_rotation

__all__ = ["MAX_ROTATION_DEVIATION", "checked_rotations"]

_ROUNDING = 1e-5
"""Below this distance a matrix is a rotation rounded to single precision, and is not changed."""


def checked_rotations(
    matrices: Float[ndarray, "n 3 3"],
) -> tuple[Float[ndarray, "n 3 3"], Float[ndarray, " n"]]:
    """Replace matrices that are nearly rotations by the nearest rotation.

    Returns
    -------
    The matrices, and each one's Frobenius distance to the nearest rotation before. Up to 1e-5 it
    is rounding, and the matrix is not changed; the caller refuses those beyond
    :data:`MAX_ROTATION_DEVIATION`.
    """
    nearest = project_to_rotation(matrices)
    distance = np.linalg.norm(matrices - nearest, axis=(-2, -1))
    return np.where(distance[:, None, None] > _ROUNDING, nearest, matrices), distance
