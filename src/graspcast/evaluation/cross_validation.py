"""TODO."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.estimates.instances import scene_groups
from graspcast.evaluation.scores import Scores, score
from graspcast.forecasting.samples import Samples
from graspcast.forecasting.splits import by_object, by_scene
from graspcast.forecasting.train import train_forecaster
from graspcast.forecasting.training_data import TrainingData, as_training_data

__all__ = ["cross_validate", "cross_validated"]


def cross_validated(
    given: Samples | TrainingData,
    *,
    by: Literal["scene", "object"] = "scene",
    folds: int = 5,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
    **options: Any,
) -> Float[ndarray, "n"]:
    """The probability of every sample by a forecaster that saw nothing of its scene, or object.

    Parameters
    ----------
    given
        Instances with outcomes, as for :func:`train_forecaster`.
    by
        Deal out the scenes (or blocks of frames), or leave out each object in turn.
    folds
        How many parts the scenes are dealt into.
    seed
        Of the dealing.
    progress
        Called with the share of the work that is done.
    options
        Those of :func:`train_forecaster`.

    Returns
    -------
        In the order of the samples; NaN where, by scene, training had nothing of the object.
    """
    learned = as_training_data(given)
    samples = learned.samples
    probability = np.full(len(samples), np.nan)
    tried = ~np.isnan(learned.success[learned.estimates.index(learned.principal)])
    # Of the lessons, what shares a scene (or the object) with the judged is kept from training.
    # Blocks of frames are those of the lessons: cut among the samples alone, they would lie
    # elsewhere.
    if by == "scene":
        every = scene_groups(learned.estimates.instances)
        parts = list(by_scene(samples, folds=folds, seed=seed, groups=every[tried]))
    else:
        every = learned.estimates.objects
        parts = [fold for _, fold in by_object(samples)]
    mine = every[tried]
    for i, (_, test) in enumerate(parts):

        def step(share: float, i: int = i) -> None:
            if progress is not None:
                progress((i + share) / len(parts))

        kept = learned.select(~np.isin(every, mine[test]))
        forecaster = train_forecaster(kept, progress=step, **options)
        if by == "scene":
            test = test[np.isin(samples.objects[test], forecaster.card.objects)]
        if not len(test):
            continue
        probability[test] = forecaster.probability(
            samples.estimates.select(test), options.get("models"), unseen_objects=by == "object"
        )
    return probability


def cross_validate(given: Samples | TrainingData, **options: Any) -> Scores:
    """Scores on scenes (or blocks of frames), or on objects, that training has not seen.

    Parameters
    ----------
    given
        Instances with outcomes, as for :func:`train_forecaster`.
    options
        Those of :func:`cross_validated`.
    """
    samples = as_training_data(given).samples
    probability = cross_validated(given, **options)
    scored = ~np.isnan(probability)
    return score(probability[scored], samples.success[scored], samples.objects[scored])
