"""Trials from which a table of thresholds is made: of verdicts, of looks, and held out in training.

What verdicts abstain from at every threshold is attempted at none: no forecast, a disagreement that
is out of distribution.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.estimates.instances import Instances, scene_groups, unit_names
from graspcast.estimates.outcomes import join_outcomes
from graspcast.evaluation.best_threshold import Trials
from graspcast.evaluation.cross_validation import (
    choices_on_other_scenes,
    cross_validated_with_views,
    views_scored,
)
from graspcast.evaluation.scores import Scores, score
from graspcast.evaluation.verdict_scores import verdict_table
from graspcast.forecasting.forecaster import Forecaster
from graspcast.forecasting.training_data import TrainingData
from graspcast.forecasting.verdict import InstanceLooks, VerdictRow

__all__ = [
    "HeldOut",
    "held_out",
    "stored_trials",
    "threshold_in_use",
    "trials_of_looks",
    "trials_of_verdicts",
]


def trials_of_verdicts(rows: Sequence[VerdictRow], outcomes: pl.DataFrame | None = None) -> Trials:
    """Return a trial for each verdict; with outcomes, for each verdict that has one.

    Parameters
    ----------
    rows
        Verdicts; the views that each rests on count as looks.
    outcomes
        As :func:`graspcast.estimates.outcomes.read_outcomes` returns them.
    """
    probability = _probability(rows)
    looks = np.array([max(1, row.views) for row in rows], dtype=np.int64)
    success = None if outcomes is None else _success(rows, outcomes)
    found = Trials.of_one_look(probability, success, _scenes(rows), looks)
    return found if success is None else found.select(~np.isnan(success))


def trials_of_looks(looks: Sequence[InstanceLooks], outcomes: pl.DataFrame | None = None) -> Trials:
    """Return a trial for each instance, of its forecasts until looking ended.

    They say what the policy would do at any threshold up to the one in use: whether a further look
    pays does not depend on the threshold. With outcomes, instances count that have one after each
    look.

    Parameters
    ----------
    looks
        Verdicts after each look.
    outcomes
        Of the grasps that each guide would try after each look.
    """
    most = max((len(each.rows) for each in looks), default=1)
    ended = np.array([each.ended for each in looks], dtype=np.int64)
    stages = [[each.rows[min(k, len(each.rows) - 1)] for each in looks] for k in range(most)]
    probability = np.stack([_probability(stage) for stage in stages], axis=1)
    number = np.arange(1, most + 1)
    probability[number > ended[:, None]] = np.nan
    success = None
    if outcomes is not None:
        success = np.stack([_success(stage, outcomes) for stage in stages], axis=1)
    taken = np.broadcast_to(number, probability.shape)
    found = Trials(probability, success, taken, ended, _scenes(stages[0]))
    return found if success is None else found.select(~np.isnan(success).any(axis=1))


def threshold_in_use(rows: Sequence[VerdictRow]) -> float | None:
    """Return the threshold that all verdicts with one have; None without one, or with several."""
    found = {row.verdict.threshold for row in rows}.difference({None})
    return next(iter(found)) if len(found) == 1 else None


def stored_trials(forecaster: Forecaster) -> Trials | None:
    """Return the out-of-fold predictions, of single views, that a forecaster keeps; None if none.

    Each is of a forest that was grown without the instance's scene. Their calibration (two numbers)
    was fitted on all of them.
    """
    kept = getattr(forecaster.predictor, "out_of_fold", None)
    if kept is None or not len(kept.probability):
        return None
    return Trials.of_one_look(kept.probability, kept.success, kept.units("scene"))


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Forecasts of instances whose scenes are not in training, with outcomes.

    Attributes
    ----------
    trials
        One forecast each; a dataset's only scene is cut into blocks of frames.
    objects
        ``dataset-number`` of each.
    """

    trials: Trials
    objects: ndarray

    @property
    def scores(self) -> Scores:
        """Of the forecasts."""
        assert self.trials.success is not None
        return score(self.trials.probability[:, 0], self.trials.success[:, 0] == 1, self.objects)


def held_out(data: TrainingData, **options: Any) -> dict[str, HeldOut]:
    """Return forecasts of each tried instance by a forecaster trained without its scene.

    Parameters
    ----------
    data
        Instances with outcomes.
    options
        Those of :func:`graspcast.evaluation.cross_validation.cross_validated`.

    Returns
    -------
        ``unseen_scenes``, from one view; with views, where there are such forecasts,
        ``unseen_scenes_views``, from two or three, guided by the principal's single view. Where
        objects have several grasps, forecasts are of the grasp that is chosen from one view.
    """
    if data.views is None or data.others:
        found = choices_on_other_scenes(replace(data, views=None), **options)
        return {"unseen_scenes": _held_out(data, *found)}
    single, several = cross_validated_with_views(data, **options)
    tried = data.tried()
    looks = np.ones(len(tried), dtype=np.int64)
    rows, used = views_scored(tried)
    looks[rows] = used
    out = {}
    for name, forecasts, taken in (
        ("unseen_scenes", single, None),
        ("unseen_scenes_views", several, looks),
    ):
        if not np.isnan(forecasts).all():
            out[name] = _held_out(data, forecasts, tried.own_success, taken)
    return out


def _held_out(
    data: TrainingData,
    probability: Float[ndarray, " n"],
    success: Float[ndarray, " n"],
    looks: Int[ndarray, " n"] | None = None,
) -> HeldOut:
    known = ~np.isnan(probability)
    scenes = scene_groups(data.estimates.instances)[data.is_tried]
    taken = None if looks is None else looks[known]
    trials = Trials.of_one_look(probability[known], success[known] == 1, scenes[known], taken)
    return HeldOut(trials, data.tried().objects[known])


def _probability(rows: Sequence[VerdictRow]) -> Float[ndarray, " n"]:
    """Return the forecasts; NaN where the verdict would abstain at every threshold."""
    found = [row.verdict.probability if row.verdict.may_attempt else None for row in rows]
    return np.array([np.nan if p is None else p for p in found], dtype=np.float64)


def _success(rows: Sequence[VerdictRow], outcomes: pl.DataFrame) -> Float[ndarray, " n"]:
    found = join_outcomes(verdict_table(rows), outcomes)["success"]
    return found.cast(pl.Float64).fill_null(float("nan")).to_numpy()


def _scenes(rows: Sequence[VerdictRow]) -> ndarray:
    return np.asarray(unit_names(Instances.of([row.key for row in rows]), "scene"))
