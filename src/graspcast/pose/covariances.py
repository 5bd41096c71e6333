"""Covariances of poses: what is none is refused, and spreads seen from any side."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError

__all__ = ["check_covariance", "check_deviations", "covariance_from_any_side"]

_MOST_SHIFT_M, _MOST_TURN_RAD = 0.5, np.pi


def check_covariance(covariance: Float[ndarray, "6 6"], what: str = "the covariance") -> None:
    """Raise unless a covariance of a pose is symmetric, positive definite, in metres and radians.

    Raises
    ------
    InputError
        Naming what is wrong.
    """
    matrix = np.asarray(covariance, dtype=np.float64)
    if matrix.shape != (6, 6) or not np.isfinite(matrix).all():
        raise InputError(f"{what} is not 6x6 finite numbers", parameters=("covariance",))
    if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=1e-12 * np.abs(matrix).max()):
        raise InputError(f"{what} is not symmetric", parameters=("covariance",))
    # Metres and radians differ in size, so its correlations are checked.
    deviation = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    if not (deviation > 0).all():
        raise InputError(
            f"{what} has a variance that is not above zero: {np.diag(matrix).tolist()}",
            parameters=("covariance",),
        )
    least = float(np.linalg.eigvalsh(matrix / np.outer(deviation, deviation))[0])
    if least < 1e-9:
        raise InputError(
            f"{what} is not positive definite: the smallest eigenvalue of its correlations is "
            f"{least:.2g}",
            parameters=("covariance",),
        )
    shift, turn = float(deviation[:3].max()), float(deviation[3:].max())
    if shift > _MOST_SHIFT_M:
        raise InputError(
            f"{what} has a standard deviation of position of {shift:.3g} m; no estimate is that "
            f"wrong. If it is in mm², divide by 10⁶: {shift / 1e3:.3g} m",
            parameters=("covariance",),
        )
    if turn > _MOST_TURN_RAD:
        raise InputError(
            f"{what} has a standard deviation of rotation of {turn:.3g} rad, more than half a "
            f"turn. If it is in degrees², it is {np.deg2rad(turn):.3g} rad",
            parameters=("covariance",),
        )


def check_deviations(across_m: float, along_m: float, rotation_rad: float) -> None:
    """Raise unless standard deviations of a pose are above zero and those of an estimate.

    Raises
    ------
    InputError
        Naming the one that is wrong, and the unit that would fit.
    """
    for what, value, most, unit in (
        ("across the viewing ray", across_m, _MOST_SHIFT_M, "m"),
        ("along the viewing ray", along_m, _MOST_SHIFT_M, "m"),
        ("of the rotation", rotation_rad, _MOST_TURN_RAD, "rad"),
    ):
        if not 0 < value <= most:
            raise InputError(
                f"the standard deviation {what} is {value:.3g} {unit}; it must be above zero and "
                f"at most {most:.3g} {unit}",
                parameters=("deviations",),
            )


def covariance_from_any_side(
    across_m: float, along_m: float, rotation_rad: float
) -> Float[ndarray, "6 6"]:
    """Return the covariance of a pose that is seen from a random side: the same on each axis.

    Parameters
    ----------
    across_m, along_m
        Standard deviations of the position across (per axis) and along the viewing ray, metres.
    rotation_rad
        Standard deviation of the rotation, radians per axis.
    """
    check_deviations(across_m, along_m, rotation_rad)
    shift = (2 * across_m**2 + along_m**2) / 3
    return np.diag(np.repeat([shift, rotation_rad**2], 3))
