"""Cross-validation of forecasters on scenes, or on objects, that are not in training."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.errors import InputError
from graspcast.estimates.instances import scene_groups
from graspcast.evaluation.scores import Scores, score
from graspcast.evaluation.view_protocols import forecast_views
from graspcast.evaluation.view_sets import ViewSet
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.splits import by_group, by_object
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.view_rankings import view_probabilities
from graspcast.io.arguments import a, checked
from graspcast.io.progress import Progress, step_of

__all__ = [
    "choices_on_other_scenes",
    "cross_validate",
    "cross_validated",
    "cross_validated_by_views",
    "cross_validated_with_views",
    "views_scored",
]

SCORED_VIEWS = 3
"""From at most how many views the instances are forecast that scores with views are of."""


_ONE_WITH_VIEWS = "forecasts with several views are cross-validated for the reference grasp alone"


def cross_validated(
    training_data: TrainingData,
    *,
    by: Literal["scene", "object"] = "scene",
    folds: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
    **options: Any,
) -> Float[ndarray, " n"]:
    """Forecast each tried instance by a forecaster trained without its scene, or object.

    Parameters
    ----------
    training_data
        Instances with outcomes, as for :func:`graspcast.train_forecaster`.
    by
        ``scene`` for folds of scenes (or blocks of frames), ``object`` to leave out each object in
        turn.
    folds
        Number of folds of scenes.
    seed
        Of the assignment of scenes to folds.
    progress
        Called with the share of the work that is done and a message.
    options
        Those of :func:`graspcast.train_forecaster`.

    Returns
    -------
        Out-of-fold probabilities of ``training_data.tried()``, in its order; NaN where, by scene,
        the object was not in training. Where objects have several grasps, they are of the grasp
        that would be chosen.

    Raises
    ------
    InputError
        If, by object, fewer than two objects have outcomes; or they have several grasps, none of
        which an unseen object shares.
    """
    how: dict[str, Any] = {"by": by, "folds": folds, "seed": seed, "progress": progress}
    return choices_on_other_scenes(training_data, **how, **options)[0]


def choices_on_other_scenes(
    training_data: TrainingData, *, by: Literal["scene", "object"] = "scene", **options: Any
) -> tuple[Float[ndarray, " n"], Float[ndarray, " n"]]:
    """Return what :func:`cross_validated` does, and the outcomes of the grasps that it is of.

    Parameters
    ----------
    training_data, by, options
        As for :func:`cross_validated`.
    """
    tried = training_data.tried()
    if by == "object":
        training_data.refuse_several(
            "objects that are not in training are scored by their one grasp", "unseen_objects"
        )
    probability, success = np.full(len(tried), np.nan), tried.own_success.copy()
    for test, forecaster in _folds(training_data, tried, by=by, **options):
        if not (forecaster.card.supporters or forecaster.visibility is not None):
            continue
        asked, models = tried.select(test), options.get("models")
        if not training_data.others:
            probability[test] = forecaster.probability(
                asked.estimates, models, unseen_objects=by == "object"
            )
            continue
        ranked = forecaster.rank(asked.estimates, models)
        names = [some[0].grasp if some else "" for some in ranked]
        success[test] = asked.outcome_of(names)
        found = np.array([some[0].probability if some else np.nan for some in ranked])
        probability[test] = np.where(np.isnan(success[test]), np.nan, found)
    return probability, success


def cross_validated_with_views(
    training_data: TrainingData,
    *,
    folds: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
    **options: Any,
) -> tuple[Float[ndarray, " n"], Float[ndarray, " n"]]:
    """Forecast each tried instance from one view, and from up to three, without its scene.

    Parameters
    ----------
    training_data
        With :attr:`TrainingData.views`.
    folds, seed, progress, options
        As for :func:`cross_validated`.

    Returns
    -------
        Out-of-fold probabilities of ``training_data.tried()`` from one view (NaN where there is no
        forecast from one), and from two or three (NaN where there are no other views); each guided
        by the principal's single view.

    Raises
    ------
    InputError
        If objects have several grasps.
    """
    training_data.refuse_several(_ONE_WITH_VIEWS)
    tried = training_data.tried()
    single, several = np.full(len(tried), np.nan), np.full(len(tried), np.nan)
    models = options.get("models")
    for test, forecaster in _folds(
        training_data, tried, by="scene", folds=folds, seed=seed, progress=progress, **options
    ):
        mine = tried.select(test)
        if forecaster.card.supporters or forecaster.visibility is not None:
            single[test] = forecaster.probability(mine.estimates, models)
        assert mine.views is not None
        rows, found = _seen(forecaster, mine, models or {})
        several[test[rows]] = found
    return single, several


def cross_validated_by_views(
    training_data: TrainingData,
    views: Mapping[int, ViewSet],
    *,
    folds: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
    **options: Any,
) -> dict[int, Float[ndarray, " n"]]:
    """Forecast each tried instance from each number of views, without its scene.

    Parameters
    ----------
    training_data
        With :attr:`TrainingData.views`.
    views
        Number of views at most to the fused poses of ``training_data.tried()``.
    folds, seed, progress, options
        As for :func:`cross_validated`.

    Returns
    -------
        Number of views at most to out-of-fold probabilities of ``training_data.tried()``, guided by
        the principal's single view; NaN where fewer than two views are left, or the object was not
        in training.

    Raises
    ------
    InputError
        If objects have several grasps.
    """
    training_data.refuse_several(_ONE_WITH_VIEWS)
    tried = training_data.tried()
    out = {most: np.full(len(tried), np.nan) for most in views}
    for test, forecaster in _folds(
        training_data, tried, by="scene", folds=folds, seed=seed, progress=progress, **options
    ):
        estimates = tried.estimates.select(test)
        for most, found in views.items():
            mine = found.select(test, len(tried))
            given = (mine, estimates, training_data.principal, options.get("models") or {})
            out[most][test[mine.data.row]] = forecast_views(forecaster, *given)
    return out


def _seen(
    forecaster: Forecaster, data: TrainingData, models: Mapping[str, Models]
) -> tuple[Int[ndarray, " m"], Float[ndarray, " m"]]:
    """Forecast instances with two or three views; return their numbers and the probabilities."""
    views = data.views
    assert views is not None
    if forecaster.view_model is None:
        return np.empty(0, dtype=np.int64), np.empty(0)
    last = _most_views(views.views, views.row)
    row, estimates = views.row[last], data.estimates
    return row, view_probabilities(
        forecaster,
        estimates.instances.select(row),
        views.statistics[last],
        views.cam_T_fused[last],
        estimates.of(data.principal)[row],
        models,
    )


def views_scored(data: TrainingData) -> tuple[Int[ndarray, " m"], Int[ndarray, " m"]]:
    """Return which instances are forecast from two or three views, and from how many."""
    assert data.views is not None
    last = _most_views(data.views.views, data.views.row)
    return data.views.row[last], data.views.views[last]


def _most_views(views: Int[ndarray, " k"], row: Int[ndarray, " k"]) -> Int[ndarray, " m"]:
    """Return of each instance's fusions the one of most views, of those with two or three."""
    kept = np.flatnonzero((views > 1) & (views <= SCORED_VIEWS))
    order = kept[np.lexsort((views[kept], row[kept]))]
    _, first = np.unique(row[order][::-1], return_index=True)
    return np.asarray(order[len(order) - 1 - first])


def _folds(
    training_data: TrainingData,
    tried: TrainingData,
    *,
    by: Literal["scene", "object"],
    folds: int = 5,
    seed: int = 0,
    progress: Progress | None = None,
    **options: Any,
) -> Iterator[tuple[Int[ndarray, " m"], Forecaster]]:
    """Yield the tested rows of each fold, and the forecaster trained without them."""
    # Groups are those of all instances, tried or not: an untried one in the test fold's scenes is
    # left out of training too.
    if by == "scene":
        groups = scene_groups(training_data.estimates.instances)
        own = groups[training_data.is_tried]
        held = (tried.own_outcomes == 1).any(axis=0)
        parts = list(by_group(own, tried.objects, held, folds=folds, seed=seed))
    else:
        needed = set(training_data.estimates.estimators).difference(options.get("learn_from", ()))
        if len(needed) < 2:
            raise InputError(
                "one estimator alone learns nothing of objects that are not in training, so these "
                "cannot be scored; a consensus of two or more can",
                parameters=("unseen_objects", "estimates"),
            )
        groups, own = training_data.objects, tried.objects
        if len(names := sorted(set(own.tolist()))) < 2:
            raise InputError(
                f"to score objects that are not in training takes two or more with outcomes, but "
                f"there is only {', '.join(names) or 'none'}",
                parameters=("unseen_objects", "objects"),
            )
        parts = list(by_object(own))
    for i, (_, test) in enumerate(parts):
        train = training_data.select(~np.isin(groups, own[test]))
        step = step_of(progress, i, len(parts), f"fold {i + 1} of {len(parts)}")
        who = {"guides": (training_data.principal,)}
        forecaster = fit_forecaster(train, progress=step, **{**who, **options})
        if by == "scene":
            test = test[np.isin(tried.objects[test], forecaster.card.objects)]
        if len(test):
            yield test, forecaster


@checked(training_data=a(TrainingData))
def cross_validate(training_data: TrainingData, **options: Any) -> Scores:
    """Score a method on scenes (or blocks of frames), or on objects, that are not in training.

    Parameters
    ----------
    training_data
        Instances with outcomes, as for :func:`graspcast.train_forecaster`.
    options
        Those of :func:`cross_validated`.
    """
    probability, success = choices_on_other_scenes(training_data, **options)
    scored = ~np.isnan(probability)
    objects = training_data.tried().objects
    return score(probability[scored], success[scored] == 1, objects[scored])
