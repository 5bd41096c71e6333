"""Spreads: how far an estimator's poses scatter, across and along its viewing ray."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import split_object_name
from graspcast.io.arguments import a, checked
from graspcast.pose.metrics import nearest_symmetric
from graspcast.pose.ray_frame import relative
from graspcast.pose.transforms import compose, invert

__all__ = ["DEFAULT_SPREAD", "Spread", "Spreads", "learn_spreads"]

_TO_DEVIATION = 1.4826
"""Standard deviation of a normal distribution divided by its median absolute value."""

_MEDIAN_OF_3 = 1.5382
"""Median length of three independent standard normal numbers."""

_FLOOR = (2e-4, 2e-4, 2e-3)


@dataclass(frozen=True)
class Spread:
    """Standard deviations of an estimator's poses.

    Attributes
    ----------
    across, along
        Of the position, across (per axis) and along the viewing ray, divided by the distance.
    rotation_rad
        Of the rotation, radians per axis.
    shared
        The share of the variance that all estimators of one image have in common, from 0 to 1;
        more estimators do not reduce it, other views do.
    """

    across: float = 0.003
    along: float = 0.012
    rotation_rad: float = 0.07
    shared: float = 0.5

    def __post_init__(self) -> None:
        sizes = (self.across, self.along, self.rotation_rad)
        if not all(np.isfinite(s) and s > 0 for s in sizes) or not 0 <= self.shared <= 1:
            raise InputError(f"spreads should be positive, and the share from 0 to 1, not {self}")


DEFAULT_SPREAD = Spread()
"""For estimators of which nothing is known: typical of published ones."""


@dataclass(frozen=True)
class Spreads:
    """The spread of each estimator, for each object where enough was seen of it.

    Attributes
    ----------
    by_estimator
        Estimator's name to its spread on all objects.
    by_object
        (estimator, object) to the spread on that object, ``dataset-obj_id``.
    default
        For all others.
    """

    by_estimator: Mapping[str, Spread] = field(default_factory=dict)
    by_object: Mapping[tuple[str, str], Spread] = field(default_factory=dict)
    default: Spread = DEFAULT_SPREAD

    def of(self, estimator: str, object_name: str) -> Spread:
        """Return the spread of an estimator's poses of an object."""
        alone = self.by_estimator.get(estimator, self.default)
        return self.by_object.get((estimator, object_name), alone)

    def table(self, estimators: tuple[str, ...], objects: ndarray) -> Float[ndarray, "n k 4"]:
        """Return across, along, rotation and shared of n objects by K estimators, (n, K, 4)."""
        names, inverse = np.unique(objects, return_inverse=True)
        rows = np.array(
            [
                [
                    (s.across, s.along, s.rotation_rad, s.shared)
                    for s in (self.of(e, str(name)) for e in estimators)
                ]
                for name in names
            ]
        ).reshape(len(names), len(estimators), 4)
        return rows[inverse]


@checked(estimates=a(Estimates), truth=a(np.ndarray))
def learn_spreads(
    estimates: Estimates,
    truth: Float[ndarray, "n 4 4"],
    *,
    models: Mapping[str, Models] | None = None,
    least: int = 30,
) -> Spreads:
    """Estimate each estimator's spread from instances with known poses.

    Robust: from medians, so that gross errors, which the fusion finds by itself, do not enter.

    Parameters
    ----------
    estimates
        Of n instances, of training scenes.
    truth
        True ``cam_T_obj``, NaN where unknown, (n, 4, 4).
    models
        Dataset's name to its object models, for symmetries.
    least
        An object with fewer instances has its estimator's spread on all objects.

    Raises
    ------
    InputError
        If fewer than ``least`` instances have a known pose.
    """
    known = np.isfinite(truth).all(axis=(1, 2)) if truth.ndim == 3 else np.zeros(0, bool)
    if len(known) != len(estimates) or known.sum() < least:
        raise InputError(
            f"spreads take at least {least} instances with known poses, but {int(known.sum())} of "
            f"{len(estimates)} have one",
            parameters=("ground_truth",),
        )
    some = estimates.select(known)
    errors = _errors(some, truth[known], models)  # (K, n, 6)
    shared = _shared(errors)
    by_estimator = {e: _spread(errors[k], shared) for k, e in enumerate(some.estimators)}
    by_object = {}
    for name in np.unique(some.objects):
        rows = some.objects == name
        if rows.sum() >= least:
            for k, estimator in enumerate(some.estimators):
                by_object[estimator, str(name)] = _spread(errors[k, rows], shared)
    return Spreads(by_estimator, by_object)


def _errors(
    estimates: Estimates, truth: Float[ndarray, "n 4 4"], models: Mapping[str, Models] | None
) -> Float[ndarray, "k n 6"]:
    out = np.empty((*estimates.cam_T_obj.shape[:2], 6))
    for name in np.unique(estimates.objects):
        dataset, number = split_object_name(str(name))
        rows = np.flatnonzero(estimates.objects == name)
        poses, true = estimates.cam_T_obj[:, rows], truth[rows]
        if models and dataset in models and number in models[dataset].info:
            symmetries = models[dataset][number].symmetries
            poses = compose(true, nearest_symmetric(compose(invert(true), poses), symmetries))
        out[:, rows] = relative(np.broadcast_to(true, poses.shape), poses)
    return out


def _spread(errors: Float[ndarray, "n 6"], shared: float) -> Spread:
    size = np.abs(errors)
    turn = np.linalg.norm(errors[:, 3:], axis=1)
    found = (
        np.median(size[:, :2]) * _TO_DEVIATION,
        np.median(size[:, 2]) * _TO_DEVIATION,
        np.median(turn) / _MEDIAN_OF_3,
    )
    across, along, rotation = (max(float(f), low) for f, low in zip(found, _FLOOR, strict=True))
    return Spread(across, along, rotation, shared)


def _shared(errors: Float[ndarray, "k n 6"]) -> float:
    """Return the mean rank correlation of the estimators' errors along the ray, from 0 to 0.95."""
    if len(errors) < 2:
        return DEFAULT_SPREAD.shared
    ranks = np.argsort(np.argsort(errors[:, :, 2], axis=1), axis=1).astype(float)
    found = np.corrcoef(ranks)[np.triu_indices(len(errors), 1)]
    return float(np.clip(np.nan_to_num(found).mean(), 0.0, 0.95))
