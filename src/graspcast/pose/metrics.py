"""Pose-error metrics: rotation and translation error, ADD, ADD-S, MSSD and MSPD.

All functions take batches: ``cam_T_est`` and ``cam_T_gt`` are (n, 4, 4), metres, and are compared
pair by pair.

References
----------
ADD, ADD-S: S. Hinterstoisser et al., *Model Based Training, Detection and Pose Estimation of
Texture-Less 3D Objects in Heavily Cluttered Scenes*, ACCV 2012.
MSSD, MSPD: T. Hodan et al., *BOP Challenge 2020*, Section 2.2.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.io.compiling import cached_njit
from graspcast.pose.parallel import over_rows
from graspcast.pose.transforms import compose, invert, rotation_angle, transform_points

__all__ = [
    "add",
    "add_s",
    "mspd",
    "mssd",
    "nearest_symmetric",
    "ray_share",
    "rotation_error",
    "translation_error",
]


_FAST = {"reassoc", "contract", "nsz"}
_DISTANCE_NS, _PIXEL_DISTANCE_NS = 1.0, 3.0
"""About how many nanoseconds a point takes."""
_ROWS_AT_ONCE = 4096


@no_type_check
@cached_njit(nogil=True, fastmath=_FAST)
def _distances(start, stop, difference, points, mean, largest):
    """Compute mean and largest length of ``D v + d`` over points v, for each difference [D | d]."""
    count = points.shape[1]
    x, y, z = points[0], points[1], points[2]
    for i in range(start, stop):
        m = difference[i]
        total, top = 0.0, 0.0
        for j in range(count):
            a = m[0, 0] * x[j] + m[0, 1] * y[j] + m[0, 2] * z[j] + m[0, 3]
            b = m[1, 0] * x[j] + m[1, 1] * y[j] + m[1, 2] * z[j] + m[1, 3]
            c = m[2, 0] * x[j] + m[2, 1] * y[j] + m[2, 2] * z[j] + m[2, 3]
            square = a * a + b * b + c * c
            total += np.sqrt(square)
            top = max(top, square)
        mean[i] = total / count
        largest[i] = np.sqrt(top)


def _mean_and_largest(
    difference: Float[ndarray, "n 3 4"], points: Float[ndarray, "v 3"]
) -> tuple[Float[ndarray, " n"], Float[ndarray, " n"]]:
    n = len(difference)
    mean, largest = np.empty(n), np.empty(n)
    given = (np.ascontiguousarray(difference), np.ascontiguousarray(points.T))
    over_rows(_distances, n, _DISTANCE_NS * len(points), *given, mean, largest)
    return mean, largest


@no_type_check
@cached_njit(nogil=True, fastmath=_FAST)
def _largest_pixel_distance(start, stop, first, second, points, out):
    """Compute the largest distance of projections by 3x4 matrices first[i] and second[i, s]."""
    symmetries, count = second.shape[1], points.shape[1]
    x, y, z = points[0], points[1], points[2]
    for i in range(start, stop):
        p = first[i]
        for s in range(symmetries):
            q = second[i, s]
            top = 0.0
            for j in range(count):
                depth = p[2, 0] * x[j] + p[2, 1] * y[j] + p[2, 2] * z[j] + p[2, 3]
                u = (p[0, 0] * x[j] + p[0, 1] * y[j] + p[0, 2] * z[j] + p[0, 3]) / depth
                v = (p[1, 0] * x[j] + p[1, 1] * y[j] + p[1, 2] * z[j] + p[1, 3]) / depth
                depth = q[2, 0] * x[j] + q[2, 1] * y[j] + q[2, 2] * z[j] + q[2, 3]
                u -= (q[0, 0] * x[j] + q[0, 1] * y[j] + q[0, 2] * z[j] + q[0, 3]) / depth
                v -= (q[1, 0] * x[j] + q[1, 1] * y[j] + q[1, 2] * z[j] + q[1, 3]) / depth
                top = max(top, u * u + v * v)
            out[i, s] = np.sqrt(top)


def nearest_symmetric(
    from_T_to: Float[ndarray, "*batch 4 4"], symmetries: Float[ndarray, "s 4 4"]
) -> Float[ndarray, "*batch 4 4"]:
    """Multiply each transform by the symmetry of frame ``to`` that minimises its rotation angle."""
    if len(symmetries) == 1:
        return from_T_to
    # The smallest angle has the largest trace, the sum of products with the transpose.
    flat = from_T_to.reshape(-1, 4, 4)
    turns = np.swapaxes(symmetries[:, :3, :3], 1, 2).reshape(-1, 9).T
    best = np.empty(len(flat), dtype=np.int64)
    for start in range(0, len(flat), _ROWS_AT_ONCE):
        rotation = flat[start : start + _ROWS_AT_ONCE, :3, :3].reshape(-1, 9)
        best[start : start + _ROWS_AT_ONCE] = (rotation @ turns).argmax(axis=1)
    return (flat @ symmetries[best]).reshape(from_T_to.shape)


def rotation_error(
    cam_T_est: Float[ndarray, "n 4 4"],
    cam_T_gt: Float[ndarray, "n 4 4"],
    symmetries: Float[ndarray, "s 4 4"] | None = None,
) -> Float[ndarray, " n"]:
    """Compute the angle between the rotations, radians, the smallest over the symmetries.

    Symmetries are applied to the estimate, as in the paper's Table II. Applied to the true pose
    they would give results that differ by some hundredths of a degree, since a file's matrix of a
    half turn is not exactly its own inverse.
    """
    if symmetries is None:
        symmetries = np.eye(4)[None]
    est_R_cam = np.swapaxes(cam_T_est[:, None, :3, :3] @ symmetries[:, :3, :3], -1, -2)
    return rotation_angle(est_R_cam @ cam_T_gt[:, None, :3, :3]).min(axis=1)


def translation_error(
    cam_T_est: Float[ndarray, "n 4 4"], cam_T_gt: Float[ndarray, "n 4 4"]
) -> Float[ndarray, " n"]:
    """Compute the distance of the objects' origins, metres."""
    return np.linalg.norm(cam_T_est[:, :3, 3] - cam_T_gt[:, :3, 3], axis=-1)


def ray_share(
    cam_T_est: Float[ndarray, "n 4 4"], cam_T_gt: Float[ndarray, "n 4 4"]
) -> Float[ndarray, " n"]:
    """Compute the share of the translation error along the viewing ray, from 0 to 1.

    The ray points from the camera to the object's true origin. NaN if there is no error.
    """
    error = cam_T_est[:, :3, 3] - cam_T_gt[:, :3, 3]
    ray = cam_T_gt[:, :3, 3]
    length = np.linalg.norm(error, axis=-1) * np.linalg.norm(ray, axis=-1)
    with np.errstate(invalid="ignore"):
        return np.abs(np.sum(error * ray, axis=-1)) / np.where(length == 0, np.nan, length)


def add(
    cam_T_a: Float[ndarray, "*#batch 4 4"],
    cam_T_b: Float[ndarray, "*#batch 4 4"],
    points: Float[ndarray, "v 3"],
) -> Float[ndarray, "*batch"]:
    """Compute ADD: the mean distance of the model's points under two poses, metres."""
    difference = (cam_T_a - cam_T_b)[..., :3, :]
    mean, _ = _mean_and_largest(difference.reshape(-1, 3, 4), points)
    return mean.reshape(difference.shape[:-2])


def add_s(
    cam_T_est: Float[ndarray, "n 4 4"],
    cam_T_gt: Float[ndarray, "n 4 4"],
    points: Float[ndarray, "v 3"],
) -> Float[ndarray, " n"]:
    """Compute ADD-S: the mean distance of true points to the nearest estimated points, metres."""
    from scipy.spatial import cKDTree

    # In the estimated object's frame the distances are the same, and one tree serves all pairs.
    tree = cKDTree(points)
    out = np.empty(len(cam_T_est))
    for i, est_T_gt in enumerate(compose(invert(cam_T_est), cam_T_gt)):
        out[i] = tree.query(transform_points(est_T_gt, points), workers=-1)[0].mean()
    return out


def mssd(
    cam_T_est: Float[ndarray, "n 4 4"],
    cam_T_gt: Float[ndarray, "n 4 4"],
    points: Float[ndarray, "v 3"],
    symmetries: Float[ndarray, "s 4 4"],
) -> Float[ndarray, " n"]:
    """Compute MSSD, the maximum symmetry-aware surface distance, metres."""
    difference = (cam_T_est[:, None] - cam_T_gt[:, None] @ symmetries)[..., :3, :]
    _, largest = _mean_and_largest(difference.reshape(-1, 3, 4), points)
    return largest.reshape(len(cam_T_est), len(symmetries)).min(axis=1)


def mspd(
    cam_T_est: Float[ndarray, "n 4 4"],
    cam_T_gt: Float[ndarray, "n 4 4"],
    points: Float[ndarray, "v 3"],
    symmetries: Float[ndarray, "s 4 4"],
    K: Float[ndarray, "n 3 3"],
) -> Float[ndarray, " n"]:
    """Compute MSPD, the maximum symmetry-aware projection distance, pixels of the camera ``K``."""
    first = K @ cam_T_est[:, :3]
    second = K[:, None] @ (cam_T_gt[:, None] @ symmetries)[..., :3, :]
    out = np.empty(second.shape[:2])
    row_ns = _PIXEL_DISTANCE_NS * len(points) * len(symmetries)
    given = (first, second, np.ascontiguousarray(points.T))
    over_rows(_largest_pixel_distance, len(out), row_ns, *given, out)
    return out.min(axis=1)
