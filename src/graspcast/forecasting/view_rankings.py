"""Forecasts and rankings of grasps with several views."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.bop.models import Models
from graspcast.estimates.instances import Instances
from graspcast.forecasting.grasp_ranking import Candidates, Ranking, Reachable
from graspcast.forecasting.models.blend import Blend
from graspcast.forecasting.models.design_matrix import nearest_to
from graspcast.forecasting.models.encoding import UNSEEN

if TYPE_CHECKING:
    from graspcast.forecasting.forecaster import Forecaster

__all__ = ["view_probabilities", "view_ranking"]


def view_probabilities(
    forecaster: Forecaster,
    instances: Instances,
    statistics: Float[ndarray, "n d"],
    cam_T_fused: Float[ndarray, "n 4 4"],
    cam_T_guide: Float[ndarray, "n 4 4"],
    models: Mapping[str, Models],
) -> Float[ndarray, " n"]:
    """Forecast the success of the best grasps by the view model.

    Parameters
    ----------
    forecaster
        Trained with views.
    instances
        What the poses are of.
    statistics, cam_T_fused
        Of the fusions, and the fused poses.
    cam_T_guide
        The poses that guide.
    models
        Dataset's name to its object models, for symmetries.

    Returns
    -------
        NaN for objects that it does not know, (n,).

    Raises
    ------
    MismatchError
        If the forecaster was trained without views.
    """
    given = instances, statistics, cam_T_fused, cam_T_guide, models
    return view_ranking(forecaster, *given).probability


def view_ranking(
    forecaster: Forecaster,
    instances: Instances,
    statistics: Float[ndarray, "n d"],
    cam_T_fused: Float[ndarray, "n 4 4"],
    cam_T_guide: Float[ndarray, "n 4 4"],
    models: Mapping[str, Models],
    reachable: Reachable | None = None,
) -> Ranking:
    """Rank the grasps of instances by the view model.

    Parameters
    ----------
    forecaster, instances, statistics, cam_T_fused, cam_T_guide, models
        As for :func:`view_probabilities`.
    reachable
        As for :meth:`Forecaster.rank`.
    """
    card, blend = forecaster.card, forecaster.predictor
    assert isinstance(blend, Blend)
    numbers = card.numbers_of(instances.objects.tolist(), unseen=True)
    candidates = Candidates.of(card, instances.to_keys, numbers, reachable)
    # Of objects that are not in training there may be no model either.
    able = np.flatnonzero(numbers != UNSEEN)
    keys, poses = instances.select(able), (cam_T_guide[able], cam_T_fused[able])
    near = np.full((len(instances), 4, 4), np.nan)
    near[able] = nearest_to(*poses, keys.dataset, keys.obj_id, models)
    row, target = candidates.row, candidates.target
    probability = blend.view_probability(statistics[row], near[row], cam_T_guide[row], target)
    return candidates.ranking(probability, None if blend.views is None else blend.views.choice)
