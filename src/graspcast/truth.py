"""Estimates against ground truth: which true instance each one means, and how far off it is."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np
import polars as pl
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.dataset import BopDataset, GroundTruth
from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.estimates import Estimates, assign, instance_numbers
from graspcast.pose import metrics
from graspcast.pose.metrics import nearest_symmetric

__all__ = ["MEASURES", "match", "measure", "nearest_truth", "summarise", "true_poses"]

MEASURES = {
    "rotation_deg": "angle between the rotations, symmetries taken into account",
    "translation_mm": "distance of the origins",
    "ray_share": "share of the translation error along the viewing ray",
    "add_mm": "average distance of model points (ADD)",
    "add_s_mm": "average distance to the nearest model point (ADD-S)",
    "mssd_mm": "maximum symmetry-aware surface distance",
    "mspd_px": "maximum symmetry-aware projection distance",
}


def match(results: Results, truth: GroundTruth) -> Int[ndarray, "n"]:
    """The row of the true instance that each estimate means, -1 where there is none.

    Several of one object in an image are paired one to one with the smallest total distance.

    Raises:
        MismatchError: if not one estimate's image is known to the ground truth.
    """
    out = _matched(
        (results.scene_id, results.im_id, results.obj_id), results.cam_T_obj[:, :3, 3], truth
    )
    if len(results) and (out < 0).all():
        raise MismatchError(
            f"{results.source}: none of its {len(results)} estimates is of an instance that "
            f"{truth.source} has; is it a CSV of another dataset or split?"
        )
    return out


def _matched(
    instances: tuple[ndarray, ndarray, ndarray], position: Float[ndarray, "n 3"], truth: GroundTruth
) -> Int[ndarray, "n"]:
    """For scene, image and object of each instance: the row of the true one, -1 for none."""
    known: dict[tuple[int, int, int], list[int]] = {}
    keys = (truth.scene_id.tolist(), truth.im_id.tolist(), truth.obj_id.tolist())
    for row, key in enumerate(zip(*keys, strict=True)):
        known.setdefault(key, []).append(row)
    asked: dict[tuple[int, int, int], list[int]] = {}
    for row, key in enumerate(zip(*(column.tolist() for column in instances), strict=True)):
        asked.setdefault(key, []).append(row)
    out = np.full(len(position), -1, dtype=np.int64)
    for key, rows in asked.items():
        true_rows = known.get(key, [])
        if not true_rows:
            continue
        pairs = assign(truth.cam_T_obj[true_rows, :3, 3], position[rows])
        for t, r in zip(*pairs, strict=True):
            out[rows[r]] = true_rows[t]
    return out


def true_poses(
    estimates: Estimates, principal: str, datasets: Mapping[str, BopDataset]
) -> Float[ndarray, "n 4 4"]:
    """``cam_T_obj`` of each instance, NaN where no ground truth has it.

    Of several of an object in an image, the one that goes with the principal's estimate.
    """
    out = np.full((len(estimates), 4, 4), np.nan)
    for name in np.unique(estimates.dataset).tolist():
        if name not in datasets:
            continue
        rows = np.flatnonzero(estimates.dataset == name)
        truth = datasets[name].ground_truth
        keys = (estimates.scene_id[rows], estimates.im_id[rows], estimates.obj_id[rows])
        found = _matched(keys, estimates.of(principal)[rows, :3, 3], truth)
        out[rows[found >= 0]] = truth.cam_T_obj[found[found >= 0]]
    return out


def nearest_truth(
    est_T_true: Float[ndarray, "n 4 4"],
    dataset: ndarray,
    obj_id: Int[ndarray, "n"],
    models: Mapping[str, Models],
) -> Float[ndarray, "n 4 4"]:
    """Each true pose, seen from an estimate, turned by the symmetry that brings it nearest.

    A turn by a symmetry is no error, but carried over to another object it would be one. Poses that
    are not known (NaN) stay as they are.

    Args:
        est_T_true: ``inv(cam_T_est) @ cam_T_true``.
        dataset, obj_id: Of which object each is, (n,).
        models: Dataset's name to its object models.
    """
    out = est_T_true.copy()
    known = np.isfinite(out).all(axis=(1, 2))
    for name, number in set(zip(dataset.tolist(), obj_id.tolist(), strict=True)):
        mine = known & (dataset == name) & (obj_id == number)
        out[mine] = nearest_symmetric(out[mine], models[name][number].symmetries)
    return out


def measure(
    results: Results,
    dataset: BopDataset,
    *,
    only: Collection[str] = tuple(MEASURES),
    progress: Callable[[float], None] | None = None,
) -> pl.DataFrame:
    """The errors of every estimate that has a ground truth, a row each.

    Args:
        results: Estimates.
        dataset: Ground truth, models and cameras.
        only: The measures that are wanted.
        progress: Called with the share of the objects that are done.

    Returns:
        ``scene_id, im_id, obj_id, inst_id`` and a column for each measure.

    Raises:
        UnknownNameError: for an object that the dataset's models lack.
        MismatchError: if no estimate has a ground truth.
    """
    truth = dataset.ground_truth
    matched = match(results, truth)
    inst_id = instance_numbers(results)
    parts = []
    present = np.unique(results.obj_id).tolist()
    for i, obj_id in enumerate(present):
        if progress is not None:
            progress(i / len(present))
        dataset.models[obj_id]
        rows = np.flatnonzero((results.obj_id == obj_id) & (matched >= 0))
        if not len(rows):
            continue
        keys = {
            "scene_id": results.scene_id[rows],
            "im_id": results.im_id[rows],
            "obj_id": results.obj_id[rows],
            "inst_id": inst_id[rows],
        }
        pair = (results.cam_T_obj[rows], truth.cam_T_obj[matched[rows]])
        images = zip(keys["scene_id"].tolist(), keys["im_id"].tolist(), strict=True)
        K = np.stack([dataset.camera_of(*image).K for image in images])
        compute = _measures(*pair, dataset.models, obj_id, K)
        parts.append(pl.DataFrame(keys | {name: compute[name]() for name in only}))
    return pl.concat(parts)


def _measures(
    est: ndarray, true: ndarray, models: Models, obj_id: int, K: ndarray
) -> dict[str, Callable[[], ndarray]]:
    """How to compute each measure of one object's estimates."""
    symmetries = models[obj_id].symmetries

    def points() -> ndarray:
        return models.mesh(obj_id).vertices

    return {
        "rotation_deg": lambda: np.degrees(metrics.rotation_error(est, true, symmetries)),
        "translation_mm": lambda: 1000 * metrics.translation_error(est, true),
        "ray_share": lambda: metrics.ray_share(est, true),
        "add_mm": lambda: 1000 * metrics.add(est, true, points()),
        "add_s_mm": lambda: 1000 * metrics.add_s(est, true, points()),
        "mssd_mm": lambda: 1000 * metrics.mssd(est, true, points(), symmetries),
        "mspd_px": lambda: metrics.mspd(est, true, points(), symmetries, K),
    }


def summarise(errors: pl.DataFrame) -> pl.DataFrame:
    """Number, mean and median of each measure for each object, and over objects alike.

    The last row (``obj_id`` null) is the mean over objects of the rows above it.
    """
    measures = [name for name in MEASURES if name in errors.columns]
    by_object = (
        errors.group_by("obj_id")
        .agg(
            pl.len().alias("n"),
            *(pl.col(m).fill_nan(None).mean().alias(f"{m}_mean") for m in measures),
            *(pl.col(m).fill_nan(None).median().alias(f"{m}_median") for m in measures),
        )
        .sort("obj_id")
    )
    overall = by_object.select(
        pl.lit(None, pl.Int64).alias("obj_id"),
        pl.col("n").sum(),
        pl.exclude("obj_id", "n").mean(),
    )
    return pl.concat([by_object, overall])
