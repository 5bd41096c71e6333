"""Tables of pose errors: every estimate against ground truth, and summaries by object."""

from __future__ import annotations

from collections.abc import Callable, Collection

import numpy as np
import polars as pl
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import InputError
from graspcast.estimates.alignment import estimate_ids
from graspcast.estimates.matching import match
from graspcast.io.arguments import a, checked
from graspcast.pose import metrics

__all__ = ["MEASURES", "measure", "summarise"]


MEASURES = {
    "rotation_deg": "angle between the rotations, symmetries taken into account",
    "translation_mm": "distance of the origins",
    "ray_share": "share of the translation error along the viewing ray",
    "add_mm": "average distance of model points (ADD)",
    "add_s_mm": "average distance to the nearest model point (ADD-S)",
    "mssd_mm": "maximum symmetry-aware surface distance",
    "mspd_px": "maximum symmetry-aware projection distance",
}


@checked(results=a(Results), dataset=a(BopDataset))
def measure(
    results: Results,
    dataset: BopDataset,
    *,
    only: Collection[str] = tuple(MEASURES),
    plausible: bool = True,
    progress: Callable[[float, str], None] | None = None,
) -> pl.DataFrame:
    """Measure the pose errors of every estimate that matches ground truth, a row each.

    Parameters
    ----------
    results
        Estimates.
    dataset
        Ground truth, models and cameras.
    only
        The wanted measures.
    plausible
        Whether estimates that agree with the ground truth only in another unit or convention are
        refused. A network that has learned little may err as much.
    progress
        Called with the share done, and words for it.

    Returns
    -------
        ``scene_id, im_id, obj_id, est_id, gt_id`` and a column for each measure.

    Raises
    ------
    InputError
        If there is no estimate.
    UnknownNameError
        For an object that the dataset's models lack.
    MismatchError
        If no estimate has a ground truth.
    """
    if not len(results):
        raise InputError(f"{results.source}: holds no estimate", parameters=("estimates",))
    truth = dataset.ground_truth
    matched = match(results, truth, plausible=plausible)
    est_id = estimate_ids(results)
    parts = []
    present = np.unique(results.obj_id).tolist()
    for i, obj_id in enumerate(present):
        if progress is not None:
            progress(i / len(present), f"measuring {dataset.name}-{obj_id}")
        dataset.models[obj_id]
        rows = np.flatnonzero((results.obj_id == obj_id) & (matched >= 0))
        if not len(rows):
            continue
        keys = {
            "scene_id": results.scene_id[rows],
            "im_id": results.im_id[rows],
            "obj_id": results.obj_id[rows],
            "est_id": est_id[rows],
            "gt_id": truth.gt_id[matched[rows]],
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
    """Summarise errors by object: number, mean and median of each measure.

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
