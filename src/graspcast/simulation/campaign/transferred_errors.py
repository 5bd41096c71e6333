"""Transferred errors: trials guided by errors that estimators made on other objects.

The probability of success given an error can be learned for an object without images of it. Errors
made on other objects, or drawn from a covariance, are transferred to it: each is seen from a random
direction, at the distance at which it was made.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import polars as pl

from graspcast.errors import InputError, MismatchError
from graspcast.io.arguments import a, checked, sequence, whole
from graspcast.io.wording import counted
from graspcast.pose.ray_frame import error_along
from graspcast.pose.transforms import rotation_from_quaternion
from graspcast.simulation.campaign.pose_errors import PoseErrors
from graspcast.simulation.campaign.requests import TrialRequests
from graspcast.simulation.objects.types import Grasp

__all__ = ["TRANSFERRED", "trials_from_transferred_errors"]

_MOST_TRIALS = 20_000_000
"""What a process plans and stores in about 20 GB of memory."""

TRANSFERRED = "transferred"
"""Value of the column ``estimator`` in such trials."""


@checked(errors=a(PoseErrors), grasps=sequence(a(Grasp)), count=whole(), seed=whole(0))
def trials_from_transferred_errors(
    errors: PoseErrors,
    grasps: Sequence[Grasp],
    *,
    count: int,
    seed: int = 0,
) -> TrialRequests:
    """Return ``count`` trials of each grasp, guided by errors made on other objects.

    All grasps of an object by a gripper are tried with the same errors.

    Parameters
    ----------
    errors
        The errors: of estimates, or drawn. Those made on the object itself are left out.
    grasps
        The grasps, of objects that are called ``dataset-number``.
    count
        Trials of each grasp.
    seed
        Random seed of the errors and viewing directions.

    Raises
    ------
    InputError
        If there is no grasp, or ``count`` is below 1, or makes more trials than any computer runs.
    MismatchError
        If there is no error of another object.
    """
    if not grasps:
        raise InputError("there are no grasps to try", parameters=("grasps",))
    if count < 1:
        raise InputError(f"count is {count}; give at least 1", parameters=("transferred_errors",))
    if count * len(grasps) > _MOST_TRIALS:
        raise InputError(
            f"{count:,} trials of each of {counted(len(grasps), 'grasp')} are too many; "
            f"give fewer, {_MOST_TRIALS:,} in all at most",
            parameters=("transferred_errors",),
        )
    keys, poses = [], []
    for grasp in grasps:
        name, gripper = grasp.object, grasp.gripper
        others = np.flatnonzero(errors.objects != name)
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
        poses.append(error_along(axes, errors.distance_m[rows], errors.truth[rows]))
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
