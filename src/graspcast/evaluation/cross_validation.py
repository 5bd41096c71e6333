"""Cross-validation of forecasters on scenes, or on objects, that are not in training."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.estimates.instances import scene_groups
from graspcast.evaluation.scores import Scores, score
from graspcast.forecasting.splits import by_group, by_object
from graspcast.forecasting.train import fit_forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.io.arguments import a, checked
from graspcast.io.progress import Progress, step_of

__all__ = ["cross_validate", "cross_validated"]


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
        the object was not in training.

    Raises
    ------
    InputError
        If, by object, fewer than two objects have outcomes.
    """
    tried = training_data.tried()
    # Groups are those of all instances, tried or not: an untried one in the test fold's scenes is
    # left out of training too.
    if by == "scene":
        groups = scene_groups(training_data.estimates.instances)
        own = groups[training_data.is_tried]
        parts = list(by_group(own, tried.objects, tried.own_success == 1, folds=folds, seed=seed))
    else:
        groups, own = training_data.objects, tried.objects
        if len(names := sorted(set(own.tolist()))) < 2:
            raise InputError(
                f"to score objects that are not in training takes two or more with outcomes, but "
                f"there is only {', '.join(names) or 'none'}",
                parameters=("unseen_objects", "objects"),
            )
        parts = list(by_object(own))
    probability = np.full(len(tried), np.nan)
    for i, (_, test) in enumerate(parts):
        train = training_data.select(~np.isin(groups, own[test]))
        step = step_of(progress, i, len(parts), f"fold {i + 1} of {len(parts)}")
        forecaster = fit_forecaster(train, progress=step, **options)
        if by == "scene":
            test = test[np.isin(tried.objects[test], forecaster.card.objects)]
        if not len(test):
            continue
        probability[test] = forecaster.probability(
            tried.estimates.select(test), options.get("models"), unseen_objects=by == "object"
        )
    return probability


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
    tried = training_data.tried()
    probability = cross_validated(training_data, **options)
    scored = ~np.isnan(probability)
    return score(probability[scored], tried.own_success[scored] == 1, tried.objects[scored])
