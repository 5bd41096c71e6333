"""Checks of estimates before they are forecast: what is not a sane pose is never attempted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.checks import copied, diameters, no_estimate_by
from graspcast.estimates.instances import InstanceKey, Instances, split_object_name
from graspcast.io.arguments import NAME, NAMED, PATH, a, mapping, number
from graspcast.pose.sanity import is_placeholder, pose_problems

__all__ = ["ARGUMENTS", "estimate_problems", "estimates_of_one", "refuse_most"]


ARGUMENTS = {
    "estimates": a(Estimates),
    "models": mapping(a(Models), "dataset"),
    "threshold": (number()[0], "a probability between 0 and 1"),
    "ood_alpha": number(0.0, 1.0),
    "poses": NAMED,
    "object_name": NAME,
    "results": mapping(a(Results), "estimator"),
    "dataset": NAME,
    "path": PATH,
}
"""The kinds of what a forecaster's methods take."""


def estimate_problems(estimates: Estimates, models: Mapping[str, Models] | None) -> list[str]:
    """Say for each instance which estimators have no sane pose of it, and why, or nothing.

    Parameters
    ----------
    estimates
        Poses of n instances.
    models
        Dataset's name to its object models; with them, distances are held against diameters.

    Returns
    -------
        Texts, empty for an instance with sane poses only, (n,).
    """
    names = estimates.estimators
    size = diameters(estimates.dataset.tolist(), estimates.obj_id.tolist(), models)
    found = [pose_problems(estimates.of(name), size) for name in names]
    out = copied(names, estimates.cam_T_obj)
    if not any(map(any, found)):
        return out
    for i in range(len(estimates)):
        said = {name: mine[i] for name, mine in zip(names, found, strict=True) if mine[i]}
        if said:
            for name in said:
                if is_placeholder(estimates.of(name)[i]):
                    said[name] = ""
            out[i] = no_estimate_by(list(said), said)
    return out


def refuse_most(estimates: Estimates, models: Mapping[str, Models] | None) -> None:
    """Raise if an estimator has no sane pose of one instance in ten, or more.

    Single wild estimates are what forecasts learn from; many are another unit or frame.

    Raises
    ------
    InputError
        Naming the estimator, and what is wrong with one of its poses.
    """
    size = diameters(estimates.dataset.tolist(), estimates.obj_id.tolist(), models)
    for name in estimates.estimators:
        said = list(filter(None, pose_problems(estimates.of(name), size)))
        if len(said) > 0.1 * len(estimates):
            raise InputError(
                f"{len(said)} of {len(estimates)} poses by {name} cannot be: one {said[0]}",
                parameters=("estimates",),
            )


def estimates_of_one(
    poses: Mapping[str, Float[ndarray, "4 4"] | None],
    object_name: str,
    models: Mapping[str, Models] | None,
) -> tuple[Estimates, str]:
    """Return the estimates of one instance, of no image in particular, and why to abstain.

    Parameters
    ----------
    poses
        Estimator's name to its ``cam_T_obj``, metres; None where it found nothing.
    object_name
        ``dataset-obj_id``.
    models
        As for :func:`estimate_problems`.

    Returns
    -------
        The estimates; and why there is no forecast, or an empty text: an estimator found nothing
        (None or a placeholder), or two are given one and the same pose, which always agrees.

    Raises
    ------
    InputError
        For a pose that no object in front of a camera can have, other than a placeholder.
    """
    dataset, obj_id = split_object_name(object_name)
    arrays = [np.eye(4) if p is None else _as_matrix(name, p) for name, p in poses.items()]
    instances = Instances.of([InstanceKey(dataset, 0, 0, obj_id, 0)])
    stacked = np.stack(arrays)
    size = np.full(len(stacked), diameters([dataset], [obj_id], models))
    missing = []
    for name, pose, problem in zip(poses, stacked, pose_problems(stacked, size), strict=True):
        if problem and not is_placeholder(pose):
            raise InputError(f"the pose by {name} {problem}")
        if problem:
            missing.append(name)
    estimates = Estimates(tuple(poses), instances, stacked[:, None])
    if missing:
        return estimates, no_estimate_by(missing, {})
    return estimates, copied(estimates.estimators, estimates.cam_T_obj)[0]


def _as_matrix(name: str, pose: Any) -> Float[ndarray, "4 4"]:
    try:
        given = np.asarray(pose)
        out = np.asarray(given, dtype=np.float64) if given.dtype.kind in "fiuO" else np.empty(0)
    except Exception:  # tensors of other libraries raise what they like
        out = np.empty(0)
    if out.shape != (4, 4):
        raise InputError(f"the pose by {name} is not a 4x4 matrix of numbers")
    return out
