"""Estimates against models, ground truth and each other: units and rotations that contradict."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import polars as pl
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.dataset import BopDataset
from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.bop.unit_checks import ratio_problem
from graspcast.errors import MismatchError
from graspcast.pose.conventions import find_convention
from graspcast.pose.lengths import between
from graspcast.pose.sanity import is_placeholder

__all__ = ["check_pairs", "check_tables", "describe_lengths"]


def check_pairs(
    mine: str, poses: Float[ndarray, "n 4 4"], other: str, others: Float[ndarray, "n 4 4"]
) -> None:
    """Raise if two sources differ in the poses of the same instances by unit or convention.

    Parameters
    ----------
    mine, other
        The sources, for messages.
    poses, others
        Poses of the same instances by both, (n, 4, 4).

    Raises
    ------
    MismatchError
        Naming both median distances and the unit that would fit, or the convention
        (:mod:`graspcast.pose.conventions`).
    """
    both = ~(is_placeholder(poses) | is_placeholder(others))
    poses, others = poses[both], others[both]
    _check_distances(mine, poses, other, others)
    if found := find_convention(poses, others):
        raise MismatchError(
            found.text(f"poses in {mine}", f"those in {other}"),
            parameters=("estimates", "ground_truth"),
        )


def _check_distances(
    mine: str, poses: Float[ndarray, "n 4 4"], other: str, others: Float[ndarray, "n 4 4"]
) -> None:
    if problem := ratio_problem(mine, _distance(poses), other, _distance(others)):
        raise MismatchError(problem, parameters=("estimates", "ground_truth"))


def check_tables(tables: Mapping[str, Results], models: Models | None) -> None:
    """Raise unless the estimators' results on a dataset fit its models and each other.

    Parameters
    ----------
    tables
        Estimator's name to its results.
    models
        The dataset's models, if they are known.

    Raises
    ------
    FormatError
        As :meth:`graspcast.bop.models.Models.check_distances`, or if ``models_info.json``
        contradicts a mesh.
    MismatchError
        If distances of the same instances by two estimators are in different units. Conventions
        are compared when the estimators are aligned.
    """
    if models is not None:
        models.check_a_mesh()
        for table in tables.values():
            models.check_distances(table.source, table.obj_id, table.cam_T_obj)
    single = {name: _single(table) for name, table in tables.items()}
    for mine, other in combinations(tables, 2):
        pairs = single[mine].join(single[other], on=["scene_id", "im_id", "obj_id"])
        _check_distances(
            tables[mine].source,
            tables[mine].cam_T_obj[pairs["row"].to_numpy()],
            tables[other].source,
            tables[other].cam_T_obj[pairs["row_right"].to_numpy()],
        )


def describe_lengths(
    name: str, dataset: BopDataset | None, estimates: Mapping[str, Float[ndarray, "n 4 4"]]
) -> str:
    """Return in one line how large the objects of a dataset are read, and how far away.

    Distances are those between which nine of ten lie. Ground truth is named where it was read.

    Parameters
    ----------
    name, dataset
        The dataset's name, and its directory if it is known.
    estimates
        Estimator's name to its poses.
    """
    parts = []
    if dataset is not None and "models" in vars(dataset):
        parts.append(f"models {dataset.models.lengths}")
    distances = []
    if dataset is not None and "ground_truth" in vars(dataset) and len(dataset.ground_truth):
        distances.append(f"ground truth {_spread(dataset.ground_truth.cam_T_obj)}")
    for estimator, poses in estimates.items():
        found = poses[~is_placeholder(poses)]
        if len(found):
            distances.append(f"{estimator} {_spread(found)}")
    if distances:
        parts.append(f"nine of ten distances: {', '.join(distances)}")
    return f"{name}: {'; '.join(parts)}" if parts else ""


def _single(table: Results) -> pl.DataFrame:
    """Return key and row of the objects that an estimator found once in an image."""
    keys = pl.DataFrame(
        {"scene_id": table.scene_id, "im_id": table.im_id, "obj_id": table.obj_id}
    ).with_row_index("row")
    return keys.filter(~pl.struct("scene_id", "im_id", "obj_id").is_duplicated())


def _distance(poses: Float[ndarray, "n 4 4"]) -> Float[ndarray, " n"]:
    return np.asarray(np.linalg.norm(poses[:, :3, 3], axis=1))


def _spread(poses: Float[ndarray, "n 4 4"]) -> str:
    low, high = np.percentile(_distance(poses), [5, 95]).tolist()
    return between(low, high)
