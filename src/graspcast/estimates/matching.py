"""Matching of estimates with ground truth."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.dataset import BopDataset, GroundTruth
from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import MismatchError
from graspcast.estimates.alignment import Estimates, assign
from graspcast.estimates.consistency import check_pairs
from graspcast.io.arguments import NAME, a, checked, mapping
from graspcast.pose.metrics import nearest_symmetric

__all__ = ["match", "nearest_truth", "true_poses"]


def match(results: Results, truth: GroundTruth, *, plausible: bool = True) -> Int[ndarray, " n"]:
    """Return the ground-truth row that each estimate matches, -1 where there is none.

    Estimates and true instances of one object in an image are assigned one to one, with the
    smallest total distance between positions.

    Parameters
    ----------
    results
        Estimates.
    truth
        Ground truth.
    plausible
        Whether estimates that agree with it only in another unit or convention are refused.

    Raises
    ------
    MismatchError
        If not one estimate's image is known to the ground truth, or if they agree with it only in
        another unit or convention.
    """
    out = _matched(
        (results.scene_id, results.im_id, results.obj_id), results.cam_T_obj[:, :3, 3], truth
    )
    if len(results) and (out < 0).all():
        raise MismatchError(
            f"{results.source}: none of its {len(results)} estimates is of an instance that "
            f"{truth.source} has; is it a CSV of another dataset or split?"
        )
    if plausible:
        _check(results.source, results.cam_T_obj, truth, out)
    return out


def _check(source: str, poses: Float[ndarray, "n 4 4"], truth: GroundTruth, row: ndarray) -> None:
    """Raise if matched estimates contradict the ground truth by unit or convention."""
    found = row >= 0
    check_pairs(source, poses[found], truth.source, truth.cam_T_obj[row[found]])


def _matched(
    instances: tuple[ndarray, ndarray, ndarray], position: Float[ndarray, "n 3"], truth: GroundTruth
) -> Int[ndarray, " n"]:
    """Return the ground-truth row of each instance (scene, image, object), -1 for none."""
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


@checked(estimates=a(Estimates), principal=NAME, datasets=mapping(a(BopDataset), "dataset"))
def true_poses(
    estimates: Estimates, principal: str, datasets: Mapping[str, BopDataset]
) -> Float[ndarray, "n 4 4"]:
    """Return the true ``cam_T_obj`` of each instance, NaN where no ground truth has it, (n, 4, 4).

    Of several instances of an object in an image, the one that matches the principal's estimate.
    """
    out = np.full((len(estimates), 4, 4), np.nan)
    for name in np.unique(estimates.dataset).tolist():
        if name not in datasets:
            continue
        rows = np.flatnonzero(estimates.dataset == name)
        truth = datasets[name].ground_truth
        keys = (estimates.scene_id[rows], estimates.im_id[rows], estimates.obj_id[rows])
        poses = estimates.of(principal)[rows]
        found = _matched(keys, poses[:, :3, 3], truth)
        _check(f"{principal} on {name}", poses, truth, found)
        out[rows[found >= 0]] = truth.cam_T_obj[found[found >= 0]]
    return out


def nearest_truth(
    est_T_true: Float[ndarray, "n 4 4"],
    dataset: ndarray,
    obj_id: Int[ndarray, " n"],
    models: Mapping[str, Models],
) -> Float[ndarray, "n 4 4"]:
    """Replace each true pose by its symmetric equivalent that is nearest to the estimate.

    A rotation by a symmetry is no error, but would be one when transferred to another object.
    Unknown poses (NaN) stay as they are.

    Parameters
    ----------
    est_T_true
        ``inv(cam_T_est) @ cam_T_true``.
    dataset, obj_id
        Of which object each is, (n,).
    models
        Dataset's name to its object models.
    """
    out = est_T_true.copy()
    known = np.isfinite(out).all(axis=(1, 2))
    for name, number in set(zip(dataset.tolist(), obj_id.tolist(), strict=True)):
        mine = known & (dataset == name) & (obj_id == number)
        out[mine] = nearest_symmetric(out[mine], models[name][number].symmetries)
    return out
