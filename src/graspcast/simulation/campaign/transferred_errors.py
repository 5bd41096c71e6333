"""Trials guided by errors that estimators made on other objects.

What a grasp of an object forgives can be learned without a single image of it: errors from the
images of other objects are put on it, each seen from a random side at the distance at which it was
made. The more of them, the finer the answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.matching import match, nearest_truth
from graspcast.pose.ray_frame import error_along, relative
from graspcast.pose.transforms import compose, invert, rotation_from_quaternion
from graspcast.simulation.campaign.requests import TrialRequests

__all__ = ["TRANSFERRED", "trials_from_transferred_errors"]

TRANSFERRED = "transferred"
"""What stands in the column ``estimator`` of such a trial."""


def trials_from_transferred_errors(
    results: Mapping[str, Mapping[str, Results]],
    datasets: Mapping[str, BopDataset],
    pairs: Sequence[tuple[str, str]],
    *,
    count: int,
    seed: int = 0,
) -> TrialRequests:
    """``count`` trials of each object with each gripper, by errors made on other objects.

    Parameters
    ----------
    results
        Dataset's name to estimator's name to results, to borrow errors from.
    datasets
        Dataset's name to its BOP directory, with ground truth.
    pairs
        Objects (``dataset-number``) and grippers.
    count
        Trials of each pair.
    seed
        Of which errors, and from which side.

    Raises
    ------
    InputError
        For a count below 1.
    MismatchError
        If there is no error of another object, or no estimate of a file has a ground truth.
    """
    if count < 1:
        raise InputError(f"at least one error is to be borrowed for each object, not {count}")
    names, distances, truths = _errors(results, datasets)
    keys, poses = [], []
    for name, gripper in pairs:
        others = np.flatnonzero(names != name)
        if not len(others):
            raise MismatchError(f"there are no errors to borrow for {name}: no estimates of others")
        dataset, _, number = name.rpartition("-")
        # The pair's own numbers, whatever else is asked for.
        random = np.random.default_rng([seed, *f"{name} {gripper}".encode()])
        rows = random.choice(others, count)
        # Normalised normal variates: rotations without a preferred direction.
        turns = random.standard_normal((count, 4))
        axes = rotation_from_quaternion(turns / np.linalg.norm(turns, axis=1, keepdims=True))
        poses.append(error_along(axes, distances[rows], truths[rows]))
        keys.append(
            pl.DataFrame({"im_id": np.arange(count)}).with_columns(
                estimator=pl.lit(TRANSFERRED),
                dataset=pl.lit(dataset),
                scene_id=pl.lit(0),
                obj_id=pl.lit(int(number)),
                est_id=pl.lit(0),
                gripper=pl.lit(gripper),
            )
        )
    return TrialRequests(pl.concat(keys), np.concatenate(poses))


def _errors(
    results: Mapping[str, Mapping[str, Results]], datasets: Mapping[str, BopDataset]
) -> tuple[ndarray, ndarray, ndarray]:
    """Of every estimate with a ground truth: object, distance, where the truth lies."""
    names, distances, truths = [], [], []
    for dataset, tables in results.items():
        truth = datasets[dataset].ground_truth
        for table in tables.values():
            matched = match(table, truth)
            rows = np.flatnonzero(matched >= 0)
            poses = table.cam_T_obj[rows]
            distance = np.linalg.norm(poses[:, :3, 3], axis=1)
            # At the camera's centre there is no ray: a placeholder for 'nothing found'.
            rows, poses, distance = (part[distance > 0] for part in (rows, poses, distance))
            names.append([f"{dataset}-{number}" for number in table.obj_id[rows].tolist()])
            distances.append(distance)
            near = nearest_truth(
                compose(invert(poses), truth.cam_T_obj[matched[rows]]),
                np.full(len(rows), dataset),
                table.obj_id[rows],
                {dataset: datasets[dataset].models},
            )
            truths.append(relative(poses, compose(poses, near)))
    return np.concatenate(names), np.concatenate(distances), np.concatenate(truths)
