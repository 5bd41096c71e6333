"""Rankings of the grasps of instances by a forecaster, from one view."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.estimates.alignment import Estimates
from graspcast.forecasting.features import Features
from graspcast.forecasting.grasp_ranking import Candidates, GraspForecast, Ranking, Reachable
from graspcast.forecasting.models.blend import Blend
from graspcast.forecasting.models.encoding import UNSEEN
from graspcast.forecasting.models.visibility import Visibility
from graspcast.forecasting.pose_checks import sane_of

if TYPE_CHECKING:
    from graspcast.forecasting.forecaster import Forecaster

__all__ = ["rank", "ranking_of", "rankings"]


def rank(
    forecaster: Forecaster,
    estimates: Estimates,
    models: Mapping[str, Models] | None = None,
    *,
    reachable: Reachable | None = None,
) -> list[tuple[GraspForecast, ...]]:
    """Forecast all grasps of every instance, the best first.

    A grasp that rests on fewer than ten outcomes comes after all others.

    Parameters
    ----------
    estimates, models
        As for :meth:`Forecaster.probability`.
    reachable
        Names of the grasps that the robot can reach: a collection for all instances; or a mapping,
        or a function, from an instance's key to its own. If None, all.

    Returns
    -------
        Of each instance; empty where :meth:`Forecaster.probability` is NaN, or nothing is
        reachable.

    Raises
    ------
    MismatchError
        As :meth:`Forecaster.probability`.
    UnknownNameError
        For a grasp that it does not know.
    """
    return rankings(forecaster, estimates, models, reachable).grasps


def rankings(
    forecaster: Forecaster,
    estimates: Estimates,
    models: Mapping[str, Models] | None,
    reachable: Reachable | None,
    unseen_objects: bool = False,
) -> Ranking:
    """Rank the grasps of every instance; there are none where poses are not sane."""
    problems = forecaster._pose_problems(estimates, models)
    forecaster.card.numbers_of(estimates.objects.tolist(), unseen_objects)
    sane = sane_of(problems)
    if sane.all():
        found, numbers = forecaster._inputs(estimates, models, unseen_objects)
        return ranking_of(forecaster, found, estimates, numbers, reachable)
    grasps: list[tuple[GraspForecast, ...]] = [()] * len(problems)
    targets = np.full(len(problems), UNSEEN, dtype=np.int64)
    if sane.any():
        some = estimates.select(sane)
        found, numbers = forecaster._inputs(some, models, unseen_objects)
        ranking = ranking_of(forecaster, found, some, numbers, reachable)
        targets[sane] = ranking.targets
        for i, ranked in zip(np.flatnonzero(sane).tolist(), ranking.grasps, strict=True):
            grasps[i] = ranked
    return Ranking(grasps, targets)


def ranking_of(
    forecaster: Forecaster,
    found: Features,
    estimates: Estimates,
    numbers: Int[ndarray, " n"],
    reachable: Reachable | None,
) -> Ranking:
    """Rank the grasps of instances whose poses are all sane.

    Parameters
    ----------
    forecaster
        That forecasts.
    found
        The features of the instances.
    estimates
        The instances.
    numbers
        Numbers of their objects.
    reachable
        As for :func:`rank`.
    """
    alone = forecaster.visibility
    usable = None if alone is None else alone.tried
    keys = estimates.instances.to_keys
    candidates = Candidates.of(forecaster.card, keys, numbers, reachable, usable)
    model = forecaster.predictor if alone is None else alone
    choice = model.choice if isinstance(model, Blend | Visibility) else None
    asked = found.values[candidates.row], candidates.target
    return candidates.ranking(forecaster.predictor.probability(*asked), choice)
