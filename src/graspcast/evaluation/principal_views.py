"""Cross-validated forecasts for each principal from several views, of all estimators and alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.loading import Inputs
from graspcast.evaluation.cross_validation import cross_validated_by_views
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.principal_forecasts import PrincipalForecasts
from graspcast.evaluation.view_sets import ViewSet
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_data import TRAINING_VIEWS, ViewData, fuse_by_views, view_data
from graspcast.io.progress import Progress, step_of
from graspcast.views.camera_motion import CameraMotion

__all__ = [
    "FusedViews",
    "PrincipalViews",
    "Seen",
    "ViewForecasts",
    "fuse_principals",
    "view_forecasts",
]

Seen = tuple[tuple[str, ...], int]
"""Whose estimates a forecast is from, the principal first, and from how many views."""


@dataclass(frozen=True, eq=False)
class FusedViews:
    """Poses of a principal's instances, fused from some estimators.

    Attributes
    ----------
    train
        From so many views as a forecaster is trained on.
    test
        Number of views at most to those of the instances with outcomes, from 2 on.
    """

    train: ViewData
    test: Mapping[int, ViewSet]


@dataclass(frozen=True, eq=False)
class PrincipalViews:
    """Poses of a principal's instances, fused from all estimators, and from its own alone."""

    together: FusedViews
    alone: FusedViews


def fuse_principals(
    inputs: Inputs,
    motions: Mapping[str, CameraMotion],
    training_data: Sequence[TrainingData],
    *,
    max_views: int = 3,
    progress: Progress | None = None,
    **rules: Any,
) -> dict[str, PrincipalViews]:
    """Fuse each principal's instances from every number of views, once each.

    Parameters
    ----------
    inputs
        All estimators' results; its notes get what is left out.
    motions
        Dataset's name to the camera motion of its scenes.
    training_data
        Of each principal.
    max_views
        Up to how many views are compared, 2 or more.
    progress
        Called with the share that is done, from 0 to 1, and a short message.
    rules
        As for :func:`~graspcast.forecasting.view_data.fuse_by_views`.

    Raises
    ------
    InputError, MismatchError
        For fewer than two views; as :func:`~graspcast.views.fused_estimates.fuse_estimates`; if no
        instance has several views.
    """
    if max_views < 2:
        raise InputError(
            f"with {max_views} view at most there is nothing to compare: give two or more, or no "
            "camera poses",
            parameters=("max_views", "camera_poses"),
        )
    out = {}
    for i, data in enumerate(training_data):
        name, found = data.principal, []
        for k, names in enumerate((data.estimates.estimators, (name,))):
            step = step_of(progress, 2 * i + k, 2 * len(training_data), f"fusing views of {name}")
            step(0.0, "")
            wanted = (inputs, motions, data.estimates.only(*names), data, max_views)
            found.append(_fused(*wanted, **rules))
            step(1.0, "")
        out[name] = PrincipalViews(*found)
    return out


def _fused(
    inputs: Inputs,
    motions: Mapping[str, CameraMotion],
    estimates: Estimates,
    data: TrainingData,
    max_views: int,
    **rules: Any,
) -> FusedViews:
    compared = range(2, max_views + 1)
    counts = sorted({*TRAINING_VIEWS, *compared})
    parts = fuse_by_views(inputs, motions, estimates.estimators, data.principal, counts, **rules)
    train = view_data(estimates, [part for most, part in parts if most in TRAINING_VIEWS], {})
    tried = estimates.select(data.is_tried)
    test = {most: ViewSet.of(tried, [p for m, p in parts if m == most]) for most in compared}
    return FusedViews(train, test)


@dataclass(frozen=True, eq=False)
class ViewForecasts:
    """Forecasts of the same grasps of one principal from one view and from several.

    Attributes
    ----------
    forecasts
        By the estimators and the number of views; the instances are the same.
    without_views
        Number of instances with fewer views, which were left out.
    contradicted
        Number of instances for which the principal's own views contradict each other so that one
        is left; it alone has no forecast then, and its probability is 0.
    """

    forecasts: Mapping[Seen, Forecasts]
    without_views: int
    contradicted: Mapping[int, int]


def view_forecasts(
    data: TrainingData,
    views: PrincipalViews,
    single: PrincipalForecasts,
    *,
    progress: Progress | None = None,
    **options: Any,
) -> ViewForecasts:
    """Forecast the instances that have every number of views, without their scenes.

    Every grasp is guided by the principal's single view. Where the views of all estimators
    contradict each other so that one is left, the forecast is that from one view.

    Parameters
    ----------
    data
        Of the principal.
    views
        Its fused poses.
    single
        Its forecasts from one view.
    progress
        Called with the share that is done, from 0 to 1, and a short message.
    options
        Of :func:`graspcast.evaluation.cross_validation.cross_validated`.

    Raises
    ------
    InputError
        If no instance has so many views.
    """
    most, name = max(views.alone.test), data.principal
    count = len(data.tried())
    kept = np.full(len(single.tried), True)
    for fused in (views.together, views.alone):
        kept &= _gathered(fused.test[most], count)[single.tried] >= most
    if not kept.any():
        raise InputError(
            f"no instance of {name} with forecasts has {most} views: compare fewer, or allow views "
            "that are nearer to each other",
            parameters=("max_views", "min_parallax", "views_from"),
        )
    rows = np.flatnonzero(kept)
    out: dict[Seen, Forecasts] = {
        ((name, *supporters), 1): forecasts.select(rows)
        for supporters, forecasts in single.forecasts.items()
    }
    everyone = (name, *single.supporters)
    full = out[everyone, 1]
    contradicted = {}
    for k, (names, fused) in enumerate(((everyone, views.together), ((name,), views.alone))):
        step = step_of(progress, k, 2, f"{name}{' alone' * k} from several views")
        mine = data.only(*(n for n in data.estimates.estimators if n in names))
        found = cross_validated_by_views(
            replace(mine, views=fused.train),
            fused.test,
            method="two-stage",
            progress=step,
            **options,
        )
        for number, values in found.items():
            probability = values[single.tried[rows]]
            unknown = np.isnan(probability)
            if names == everyone:
                probability = np.where(unknown, full.probability, probability)
            else:
                probability = np.where(unknown, 0.0, probability)
                contradicted[number] = int(unknown.sum())
            method = f"{', '.join(names)}, {number} views"
            out[names, number] = replace(full, method=method, probability=probability)
    return ViewForecasts(out, int((~kept).sum()), contradicted)


def _gathered(found: ViewSet, count: int) -> Int[ndarray, " n"]:
    """Return how many views each of ``count`` instances has, whether they entered or not."""
    out = np.ones(count, dtype=np.int64)
    out[found.data.row] = found.gathered
    return out
