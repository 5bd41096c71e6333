"""Statistics of a fusion: how sure a fused pose is, in numbers that do not depend on the object.

Lengths are divided by distances, so what is learned from one object holds for another one. None
uses ground truth, and none depends on how many estimators or views there are, so one error model
serves for any.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

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
    for size in _sizes(fused, by):
        over = (np.nanmedian, np.nanmax, np.nanmean)
        columns.extend(np.log(_SMALLEST + _over(size, used, how)) for how in over)
    own = np.where(gathered.present[:, 0, :, None], by[:, 0], np.nan)
    columns.extend(compressed(_quiet(np.nanmedian, own)).T)
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


def _over(
    size: Float[ndarray, "n v k"],
    used: Bool[ndarray, "n v k"],
    how: Callable[..., ndarray],
) -> Float[ndarray, " n"]:
    return _quiet(how, np.where(used, size, np.nan).reshape(len(size), -1))


def _quiet(how: Callable[..., ndarray], values: ndarray) -> ndarray:
    """Reduce along axis 1, without what is missing; 0 where all is."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nan_to_num(how(values, axis=1), nan=0.0)
