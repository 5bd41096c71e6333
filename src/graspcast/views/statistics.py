"""Statistics of a fusion: how sure a fused pose is, in numbers that do not depend on the object.

Lengths are divided by distances, so what is learned from one object holds for another one. None
uses ground truth, and none depends on how many estimators or views there are, so one error model
serves for any.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.pose.ray_frame import compressed, relative
from graspcast.pose.transforms import norms
from graspcast.views.fused_estimates import FusedEstimates

__all__ = ["RESIDUALS", "STATISTICS", "fusion_statistics"]

_RESIDUALS = {
    f"{what}_{how}": f"{how} over the estimates that entered of {meaning}, logarithm"
    for what, meaning in (
        ("along", "the distance from the fused origin along its own ray, over the distance"),
        ("across", "the distance from the fused origin across its own ray, over the distance"),
        ("angle", "the angle to the fused rotation"),
    )
    for how in ("median", "maximum", "mean")
}
STATISTICS: dict[str, str] = {
    "sd_along": "standard deviation along the judged ray, over the distance, logarithm",
    "sd_across": "standard deviation across the judged ray, over the distance, logarithm",
    "sd_rotation": "standard deviation of the rotation per axis, radians, logarithm",
    "parallax": "largest angle between two views that entered, radians",
    "views": "number of views that entered",
    "estimates": "number of estimates that entered",
    "dropped": "number of estimates that contradict the others",
    "distance": "distance of the fused origin from the judged camera, metres",
    "sd_smallest": "standard deviation along the surest axis of the position, metres, logarithm",
    "sd_largest": "standard deviation along the least sure axis, metres, logarithm",
    **_RESIDUALS,
    "own_shift_x": "median over the judged image's estimates of their origin from the fused one, "
    "over the distance, ray frame x, compressed",
    "own_shift_y": "the same, y",
    "own_shift_z": "the same, along the ray",
    "own_turn_x": "median over the same of the rotation vector from the fused pose, ray frame x, "
    "compressed",
    "own_turn_y": "the same, y",
    "own_turn_z": "the same, about the ray",
}
"""Names of the statistics, in the order of the columns, and their meanings."""

RESIDUALS = tuple(list(STATISTICS).index(name) for name in _RESIDUALS)
"""Columns that say how far the estimates are from the fused pose; larger is worse."""

_SMALLEST = 1e-4


def fusion_statistics(fused: FusedEstimates) -> Float[ndarray, "n d"]:
    """Compute the statistics of n fused poses, in the order of :data:`STATISTICS`.

    Parameters
    ----------
    fused
        Fused poses, with the estimates that they were fused from.
    """
    poses, gathered = fused.poses, fused.gathered
    pose, used = poses.cam_T_obj, poses.used
    distance = norms(pose[:, :3, 3])[:, 0]
    values = np.linalg.eigvalsh(poses.covariance[:, :3, :3])
    smallest, largest = np.sqrt(np.maximum(values[:, [0, 2]], 1e-18)).T
    by = relative(pose[:, None, None], poses.cam_T_est)
    columns = [
        np.log(poses.along_m / distance),
        np.log(poses.across_m / distance),
        np.log(poses.rotation_rad),
        poses.parallax_rad,
        fused.views,
        used.sum(axis=(1, 2)),
        poses.dropped.sum(axis=(1, 2)),
        distance,
        np.log(smallest),
        np.log(largest),
    ]
    there = used.reshape(len(used), -1)
    for size in _sizes(fused, by):
        values = size.reshape(there.shape)
        found = (_median(values, there), _largest(values, there), _mean(values, there))
        columns.extend(np.log(_SMALLEST + value) for value in found)
    mine = np.repeat(gathered.present[:, 0, :, None], by.shape[-1], axis=2)
    columns.extend(compressed(_median(by[:, 0], mine)).T)
    return np.stack(columns, axis=1)


def _sizes(fused: FusedEstimates, by: Float[ndarray, "n v k 6"]) -> list[Float[ndarray, "n v k"]]:
    """Return each estimate's distance from the fused pose along and across its ray, and angle."""
    gathered, poses = fused.gathered, fused.poses
    position = gathered.view_T_obj[..., :3, 3]
    distance = norms(position)
    safe = np.where(distance > 0, distance, 1.0)
    turn = gathered.cam_T_view[..., :3, :3]
    ray = np.einsum("nvij,nvkj->nvki", turn, position / safe)
    away = poses.cam_T_est[..., :3, 3] - poses.cam_T_obj[:, None, None, :3, 3]
    along = (away * ray).sum(axis=-1)
    across = np.sqrt(np.maximum((away**2).sum(axis=-1) - along**2, 0.0))
    return [np.abs(along) / safe[..., 0], across / safe[..., 0], norms(by[..., 3:])[..., 0]]


# NumPy's functions for missing values warn where all are missing, and to silence them is not safe
# where several threads do. These are 0 there.


def _median(values: Float[ndarray, "n m *d"], there: Bool[ndarray, "n m *d"]) -> ndarray:
    """Return the median along axis 1 of the values that are there."""
    ordered = np.sort(np.where(there, values, np.inf), axis=1)
    count = there.sum(axis=1, keepdims=True)
    middle = (np.maximum(count - 1, 0) // 2, np.minimum(count // 2, values.shape[1] - 1))
    low, high = (np.take_along_axis(ordered, i, axis=1) for i in middle)
    return np.where(count > 0, (low + high) / 2, 0.0)[:, 0]


def _largest(values: Float[ndarray, "n m"], there: Bool[ndarray, "n m"]) -> Float[ndarray, " n"]:
    largest = np.where(there, values, -np.inf).max(axis=1)
    return np.where(there.any(axis=1), largest, 0.0)


def _mean(values: Float[ndarray, "n m"], there: Bool[ndarray, "n m"]) -> Float[ndarray, " n"]:
    total = np.where(there, values, 0.0).sum(axis=1)
    return np.asarray(total / np.maximum(there.sum(axis=1), 1))
