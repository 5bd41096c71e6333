"""Transferred errors: trials guided by errors that estimators made on other objects.

The probability of success given an error can be learned for an object without images of it. Errors
made on other objects are transferred to it: each is seen from a random direction, at the distance
at which it was made.
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
from graspcast.simulation.objects.types import Grasp

__all__ = ["TRANSFERRED", "trials_from_transferred_errors"]

TRANSFERRED = "transferred"
"""Value of the column ``estimator`` in such trials."""


def trials_from_transferred_errors(
    results: Mapping[str, Mapping[str, Results]],
    datasets: Mapping[str, BopDataset],
    grasps: Sequence[Grasp],
    *,
    count: int,
    seed: int = 0,
) -> TrialRequests:
    """Return ``count`` trials of each grasp, guided by errors made on other objects.

    All grasps of an object by a gripper are tried with the same errors.

    Parameters
    ----------
    results
        Dataset's name to estimator's name to results, whose errors are transferred.
    datasets
        Dataset's name to its BOP directory, with ground truth.
    grasps
        The grasps, of objects that are called ``dataset-number``.
    count
        Trials of each grasp.
    seed
        Random seed of the errors and viewing directions.

    Raises
    ------
    InputError
        If ``count`` is below 1.
    MismatchError
        If there is no error of another object, or no estimate of a file has a ground truth.
    """
    if count < 1:
        raise InputError(f"count is {count}; give at least 1", parameters=("transferred_errors",))
    names, distances, truths = _errors(results, datasets)
    keys, poses = [], []
    for grasp in grasps:
        name, gripper = grasp.object, grasp.gripper
        others = np.flatnonzero(names != name)
        if not len(others):
            raise MismatchError(
                f"no errors to transfer to {name}: there are no estimates of other objects",
                parameters=("estimates",),
            )
        dataset, number = _dataset_and_number(name)
        # A stream of its own for each pair, whatever other pairs are requested.
        random = np.random.default_rng([seed, *f"{name} {gripper}".encode()])
        rows = random.choice(others, count)
        # Normalised normal variates are uniform rotations.
        turns = random.standard_normal((count, 4))
        axes = rotation_from_quaternion(turns / np.linalg.norm(turns, axis=1, keepdims=True))
        poses.append(error_along(axes, distances[rows], truths[rows]))
        keys.append(
            pl.DataFrame({"im_id": np.arange(count)}).with_columns(
                estimator=pl.lit(TRANSFERRED),
                dataset=pl.lit(dataset),
                scene_id=pl.lit(0),
                obj_id=pl.lit(number),
                est_id=pl.lit(0),
                gripper=pl.lit(gripper),
                grasp=pl.lit(grasp.name),
            )
        )
    return TrialRequests(pl.concat(keys), np.concatenate(poses))


def _dataset_and_number(name: str) -> tuple[str, int]:
    dataset, _, number = name.rpartition("-")
    if not dataset or not number.isdecimal():
        raise InputError(
            f"the object {name!r} has no number: outcomes name an object by dataset and number, so "
            f"call it DATASET-NUMBER ({name or 'mug'}-1) in the catalogue and the grasps too",
            parameters=("objects",),
        )
    return dataset, int(number)


def _errors(
    results: Mapping[str, Mapping[str, Results]], datasets: Mapping[str, BopDataset]
) -> tuple[ndarray, ndarray, ndarray]:
    """Return object, distance and relative true pose of every estimate with a ground truth."""
    names, distances, truths = [], [], []
    for dataset, tables in results.items():
        truth = datasets[dataset].ground_truth
        for table in tables.values():
            matched = match(table, truth)
            rows = np.flatnonzero(matched >= 0)
            poses = table.cam_T_obj[rows]
            distance = np.linalg.norm(poses[:, :3, 3], axis=1)
            # A distance of zero has no viewing ray; it is a placeholder for 'nothing found'.
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
