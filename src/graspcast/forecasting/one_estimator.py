"""Training for one view of one estimator, which nothing can contradict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from graspcast.errors import InputError
from graspcast.estimates.instances import scene_groups, unit_names
from graspcast.forecasting.models.blend import Blend, ForestSettings
from graspcast.forecasting.models.targets import Targets
from graspcast.forecasting.models.visibility import Visibility
from graspcast.forecasting.models.visibility_settings import VisibilitySettings
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.visibility_features import features_of_one
from graspcast.io.progress import Progress

__all__ = [
    "ALONE",
    "check_alone",
    "check_learned",
    "fit_alone",
    "learns_alone",
    "visibility_settings",
    "with_alone",
]

ALONE = "visibility"
"""The method of a forecaster of one estimator that was trained without views."""
_LEAST = 10


def learns_alone(data: TrainingData) -> bool:
    """Whether one estimator's single view is to be forecast, and there is enough to learn it."""
    own = data.own_outcomes
    tried, successes = int((~np.isnan(own)).sum()), int((own == 1).sum())
    return len(data.estimates.estimators) == 1 and tried >= _LEAST and 0 < successes < tried


def check_alone(data: TrainingData, method: str) -> None:
    """Raise if there is a single estimator, without views, of which a method can learn nothing.

    Raises
    ------
    InputError
        Saying what would help.
    """
    if len(data.estimates.estimators) > 1:
        return
    if method not in ("blend", "direct"):
        raise InputError(
            f"the method {method} takes at least two estimators, but there is 1: give the results "
            "of another one too, or choose the method blend, which then forecasts by visibility",
            parameters=("estimates", "method"),
        )
    if data.simulated is not None and not data.is_tried.any():
        raise InputError(
            "one view of one estimator is forecast by what was seen where its grasps succeeded, so "
            "it takes their outcomes; simulated trials serve with two estimators or camera poses",
            parameters=("outcomes", "estimates", "camera_poses"),
        )


def check_learned(
    names: Sequence[str], principal: str, method: str, *, alone: bool, views: bool
) -> None:
    """Raise if a method can learn nothing from the outcomes of further estimators.

    Parameters
    ----------
    names
        Estimators that are learned from, but not needed at run time.
    principal
        The estimator whose grasps are to be forecast.
    method
        Of the forecaster.
    alone
        Whether the principal is the only estimator at run time.
    views
        Whether there are poses fused from several views.

    Raises
    ------
    InputError
        Saying what would help.
    """
    if not names:
        return
    listed = ", ".join(names)
    if method not in ("blend", "two-stage"):
        raise InputError(
            f"the method {method} learns nothing from outcomes of estimators that are not there at "
            f"run time ({listed}); blend and two-stage do, by success given error",
            parameters=("learn_from", "method"),
        )
    if alone and not views:
        raise InputError(
            f"one view of {principal} alone is forecast by what was seen where its own grasps "
            f"succeeded, which outcomes of {listed} do not tell; they serve with several views of "
            "it (give camera poses), or with a second estimator at run time",
            parameters=("learn_from", "camera_poses", "estimates"),
        )


def visibility_settings(settings: ForestSettings) -> VisibilitySettings:
    """Return the settings of a visibility model by those of forests."""
    return VisibilitySettings(trees=settings.trees, folds=settings.folds, seed=settings.seed)


def fit_alone(
    data: TrainingData,
    targets: Targets,
    settings: ForestSettings,
    *,
    progress: Progress | None = None,
) -> Visibility:
    """Train on the outcomes of a single estimator, by what is known of its estimates.

    Parameters
    ----------
    data
        Instances of one estimator; :attr:`Estimates.seen` has score and image fit.
    targets
        The objects to forecast, and their grasps.
    settings
        Of the forests.
    progress
        Called with the share of the work that is done and a message.
    """
    names, count = data.objects.tolist(), len(data.grasps)
    keys, found = data.estimates.instances, features_of_one(data.estimates)
    return Visibility.fit(
        replace(found, values=np.tile(found.values, (count, 1))),
        data.own_outcomes.ravel(),
        np.concatenate([targets.numbers(names, grasp) for grasp in data.grasps]),
        np.tile(scene_groups(keys), count),
        np.tile(unit_names(keys, "image"), count),
        objects=len(targets),
        grasps=count,
        settings=visibility_settings(settings),
        progress=progress,
    )


def with_alone(blend: Blend, visibility: Visibility) -> Blend:
    """Return a model of several views that answers for one view too."""
    kept = visibility.out_of_fold
    return replace(blend, visibility=replace(visibility, out_of_fold=None), out_of_fold=kept)
