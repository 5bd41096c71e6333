"""Checks of estimates before they are forecast: what is not a sane pose is never attempted."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.bop.results import Results
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.checks import copied, diameters, no_estimate_by
from graspcast.estimates.instances import InstanceKey, Instances, split_object_name
from graspcast.forecasting.model_card import ModelCard
from graspcast.io.arguments import NAME, NAMED, PATH, a, mapping, number
from graspcast.pose.lengths import shown
from graspcast.pose.sanity import as_pose, is_placeholder, pose_problems

__all__ = [
    "ARGUMENTS",
    "ONE_VIEW",
    "SIZE_TOLERANCE",
    "alone_problems",
    "estimate_problems",
    "estimates_of_one",
    "refuse_most",
    "sane_of",
    "sizes_of",
]


SIZE_TOLERANCE = 0.1
"""Share by which an object's diameter may differ from that in training."""

ONE_VIEW = "one view by one estimator: there is nothing that could contradict it"
"""Why there is no forecast from one view by a model that was trained to fuse several."""

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


def sizes_of(
    estimates: Estimates, models: Mapping[str, Models] | None, card: ModelCard | None = None
) -> Float[ndarray, " n"]:
    """Return the diameter of each instance's object, metres, NaN where unknown.

    Parameters
    ----------
    estimates
        Poses of n instances.
    models
        Dataset's name to its object models.
    card
        A forecaster's card: its diameters serve where no model is given.

    Raises
    ------
    MismatchError
        If an object has another size than in training.
    """
    trained = None if card is None else card.diameters_of(estimates.objects)
    if trained is not None and not models:
        return trained
    given = diameters(estimates.dataset.tolist(), estimates.obj_id.tolist(), models)
    if trained is None:
        return given
    other = np.abs(given - trained) > SIZE_TOLERANCE * trained
    if other.any():
        i = int(np.argmax(other))
        raise MismatchError(
            f"{estimates.objects[i]} is {shown(given[i])} across by its model, but was "
            f"{shown(trained[i])} in training: these are models of another dataset, or scaled",
            parameters=("bop", "models"),
        )
    return np.where(np.isnan(given), trained, given)


def estimate_problems(
    estimates: Estimates, models: Mapping[str, Models] | None, card: ModelCard | None = None
) -> list[str]:
    """Say for each instance which estimators have no sane pose of it, and why, or nothing.

    Parameters
    ----------
    estimates
        Poses of n instances.
    models, card
        As for :func:`sizes_of`; distances are held against diameters that are known.

    Returns
    -------
        Texts, empty for an instance with sane poses only, (n,).
    """
    names, count = estimates.estimators, len(estimates)
    size = np.tile(sizes_of(estimates, models, card), len(names))
    found = pose_problems(estimates.cam_T_obj.reshape(-1, 4, 4), size)
    out = copied(names, estimates.cam_T_obj)
    if not any(found):
        return out
    for i in range(count):
        said = {name: found[k * count + i] for k, name in enumerate(names)}
        said = {name: text for name, text in said.items() if text}
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


def sane_of(problems: list[str]) -> Bool[ndarray, " n"]:
    """Return the mask of instances without a problem."""
    return np.array([not problem for problem in problems], dtype=bool)


def alone_problems(
    tried: Bool[ndarray, " o"] | None, objects: ndarray, numbers: Int[ndarray, " n"]
) -> list[str]:
    """Say for each instance why one estimator's single view cannot be judged, or nothing.

    Parameters
    ----------
    tried
        Of which objects of the training there were outcomes; None if there is no model of a single
        view.
    objects, numbers
        The objects' names, and their numbers in training, -1 if they were not there.
    """
    if tried is None:
        return [ONE_VIEW] * len(objects)
    known_ones = (numbers >= 0) & tried[numbers]
    return [
        "" if known else f"one view by one estimator: there was no outcome of {name} in training"
        for name, known in zip(objects.tolist(), known_ones.tolist(), strict=True)
    ]


def estimates_of_one(
    poses: Mapping[str, Float[ndarray, "4 4"] | None],
    object_name: str,
    seen: Mapping[str, Float[ndarray, "1 n"]] | None = None,
) -> Estimates:
    """Return the estimates of one instance, of no image in particular.

    Parameters
    ----------
    poses
        Estimator's name to its ``cam_T_obj``, metres; None, where it found nothing, becomes a
        placeholder.
    object_name
        ``dataset-obj_id``.
    seen
        What else is known of a single estimator's estimate (:attr:`Estimates.seen`).

    Raises
    ------
    InputError
        For what is not a 4x4 matrix of numbers.
    """
    arrays = [np.eye(4) if p is None else as_pose(name, p) for name, p in poses.items()]
    dataset, obj_id = split_object_name(object_name)
    instances = Instances.of([InstanceKey(dataset, 0, 0, obj_id, 0)])
    known = (seen or {}) if len(poses) == 1 else {}
    return Estimates(tuple(poses), instances, np.stack(arrays)[:, None], seen=known)
