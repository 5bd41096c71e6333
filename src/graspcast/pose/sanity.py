"""Sanity of pose estimates: what cannot be the pose of an object seen by a camera.

Every entrance for poses uses these checks: results files, Python calls, estimators' conformance.
A pose that fails is no estimate, and is never attempted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.lengths import Reference, between, shown, unit_problem
from graspcast.pose.transforms import norms

__all__ = [
    "FARTHEST_DIAMETERS",
    "FARTHEST_M",
    "MAX_ROTATION_DEVIATION",
    "NEAREST_DIAMETERS",
    "NEAREST_M",
    "USUAL_DIAMETERS",
    "as_pose",
    "distance_reference",
    "is_placeholder",
    "looks_transposed",
    "pose_problems",
    "rotation_problem",
]

MAX_ROTATION_DEVIATION = 0.02
"""Frobenius distance to the nearest rotation from which a matrix is refused."""

FARTHEST_DIAMETERS = 100.0
"""An object farther away than this many of its diameters covers a few pixels and has no pose.

At a focal length of 600 pixels 100 diameters are 6 pixels. Of the 16,604 published estimates of
EPOS, GDRNPP and ZebraPose on LM-O and YCB-V one is farther (102). A pose in centimetres or
millimetres that is given as metres is.
"""

NEAREST_DIAMETERS = 0.5
"""Nearer than this, the camera is inside the object's bounding sphere. Published: 0.62 or more."""

USUAL_DIAMETERS = (1.0, 30.0)
"""Distances in diameters that suggest a unit of length."""
NEAREST_M, FARTHEST_M = 0.02, 20.0
"""The range where the object's size is unknown; published estimates are 0.3 to 2 m away."""
_UNIT, _LAST_ROW = np.eye(3), np.array([0.0, 0.0, 0.0, 1.0])


def as_pose(whose: str, pose: Any) -> Float[ndarray, "4 4"]:
    """Return a pose that was given as an array of another kind, unchecked but for its shape.

    Parameters
    ----------
    whose
        The estimator, for the message.
    pose
        What was given; masked entries become NaN.

    Raises
    ------
    InputError
        For what is not a 4x4 matrix of numbers.
    """
    try:
        given = np.asarray(pose)
        out = np.asarray(given, dtype=np.float64) if given.dtype.kind in "fiuO" else np.empty(0)
        if np.ma.isMaskedArray(pose):  # what is masked is not known
            out = np.where(np.ma.getmaskarray(pose), np.nan, out)
    except Exception:  # tensors of other libraries raise what they like
        out = np.empty(0)
    if out.shape != (4, 4):
        raise InputError(f"the pose by {whose} is not a 4x4 matrix of numbers")
    return out


def is_placeholder(cam_T_obj: Float[ndarray, "*n 4 4"]) -> Bool[ndarray, "*n"]:
    """Return which poses have the object's origin at the camera's centre.

    Estimators write the identity, or some rotation with zero translation, where they found nothing.
    A translation in the last row is that of a transposed matrix, which is none.
    """
    nowhere = np.abs(cam_T_obj[..., :3, 3]) < 1e-9
    return np.asarray((nowhere & (np.abs(cam_T_obj[..., 3, :3]) < 1e-9)).all(axis=-1))


def pose_problems(
    cam_T_obj: Float[ndarray, "n 4 4"], diameter_m: Float[ndarray, " n"] | None = None
) -> list[str]:
    """Say for each pose what is wrong with it, or nothing.

    Parameters
    ----------
    cam_T_obj
        Poses of objects in the camera frame (OpenCV), metres, (n, 4, 4).
    diameter_m
        The objects' diameters, metres, NaN where unknown; without them distances are only held
        against the wide range from :data:`NEAREST_M` to :data:`FARTHEST_M`.

    Returns
    -------
        The first problem of each pose as text, an empty text for a sane pose.
    """
    size = np.full(len(cam_T_obj), np.nan) if diameter_m is None else diameter_m
    out = [""] * len(cam_T_obj)
    with np.errstate(over="ignore", invalid="ignore"):  # numbers near the largest there are
        for i in np.flatnonzero(~_sane(cam_T_obj, size)).tolist():
            out[i] = _problem(cam_T_obj[i], float(size[i]))
    return out


def _sane(
    cam_T_obj: Float[ndarray, "n 4 4"], diameter_m: Float[ndarray, " n"]
) -> Bool[ndarray, " n"]:
    """Find the poses that need no closer look, all at once, since nearly all are sane."""
    R, t = cam_T_obj[:, :3, :3], cam_T_obj[:, :3, 3]
    unknown = np.isnan(diameter_m)
    nearest = np.where(unknown, NEAREST_M, NEAREST_DIAMETERS * diameter_m)
    farthest = np.where(unknown, FARTHEST_M, FARTHEST_DIAMETERS * diameter_m)
    with np.errstate(all="ignore"):
        # Stricter than the distance to the nearest rotation, which takes a decomposition. Numbers
        # that are not finite make either this or the distance infinite or NaN, which fits nowhere.
        deviation = norms((R.swapaxes(1, 2) @ R - _UNIT).reshape(-1, 9))[:, 0]
        distance = norms(t)[:, 0]
        placed = (distance >= nearest) & (distance <= farthest) & (t[:, 2] > 0)
        # Of a matrix so near to a rotation or a reflection the determinant is about 1 or -1.
        proper = (deviation < MAX_ROTATION_DEVIATION) & (np.linalg.det(R) > 0)
    last = (cam_T_obj[:, 3] == _LAST_ROW).all(axis=1)
    return np.asarray(placed & proper & last & ~is_placeholder(cam_T_obj))


def _problem(pose: Float[ndarray, "4 4"], diameter_m: float) -> str:
    if not np.isfinite(pose).all():
        return "holds numbers that are not finite"
    if np.abs(pose[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-6:
        row = " ".join(f"{x:g}" for x in pose[3])
        return f"has the last row {row}, not 0 0 0 1" + (
            "; it looks transposed" if looks_transposed(pose) else ""
        )
    if is_placeholder(pose):
        return "lies at the camera's centre: a placeholder for 'nothing found'"
    if problem := rotation_problem(pose[:3, :3]):
        return problem
    if pose[2, 3] <= 0:
        return f"lies behind the camera (z = {pose[2, 3]:.3g} m)"
    return _distance_problem(float(np.linalg.norm(pose[:3, 3])), diameter_m)


def looks_transposed(pose: Float[ndarray, "4 4"]) -> bool:
    """Return whether a matrix has its translation in the last row, and none in the last column."""
    return bool(np.abs(pose[:3, 3]).max() < 1e-9 < np.abs(pose[3, :3]).max())


def rotation_problem(R: Float[ndarray, "3 3"]) -> str:
    """Say why a matrix is no rotation, or nothing."""
    U, scales, Vt = np.linalg.svd(R)
    with np.errstate(over="ignore", invalid="ignore"):  # numbers near the largest there are
        mirrored, away = np.linalg.det(R) < 0, np.linalg.norm(R - U @ Vt)
    if mirrored:
        return "has a mirrored rotation (determinant below 0)"
    if away > MAX_ROTATION_DEVIATION:
        if np.ptp(scales) < MAX_ROTATION_DEVIATION * scales.max():
            return f"has a rotation scaled by {scales.mean():.4g}"
        return "has a rotation that is no rotation matrix"
    return ""


def _distance_problem(distance_m: float, diameter_m: float) -> str:
    if not np.isfinite(diameter_m):
        where = f"an object of unknown size should be {between(NEAREST_M, FARTHEST_M)} away"
        return unit_problem(
            "has a distance that", distance_m, Reference(where, NEAREST_M, FARTHEST_M)
        )
    reference = distance_reference(diameter_m, NEAREST_DIAMETERS, FARTHEST_DIAMETERS)
    return unit_problem("has a distance that", distance_m, reference)


def distance_reference(diameter_m: float, nearest: float, farthest: float) -> Reference:
    """Return the distances at which an object can be seen, in terms of its diameter.

    Parameters
    ----------
    diameter_m
        The object's diameter, metres.
    nearest, farthest
        The least and the largest distance, in diameters.
    """
    low, high = nearest * diameter_m, farthest * diameter_m
    return Reference(
        f"an object {shown(diameter_m)} across should be {between(low, high)} away",
        low,
        high,
        usual_m=(USUAL_DIAMETERS[0] * diameter_m, USUAL_DIAMETERS[1] * diameter_m),
    )
