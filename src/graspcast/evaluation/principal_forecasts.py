"""Cross-validated forecasts for each principal, with several sets of supporters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float, Int
from numpy import ndarray

from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import scene_groups
from graspcast.estimates.loading import Inputs
from graspcast.evaluation.cross_validation import cross_validated
from graspcast.evaluation.predictions import Forecasts
from graspcast.forecasting.training_data import TrainingData
from graspcast.io.progress import Progress, step_of
from graspcast.io.wording import counted

__all__ = [
    "PrincipalForecasts",
    "common_rows",
    "forecast_principals",
    "principal_training_data",
]


def principal_training_data(
    inputs: Inputs, outcomes: pl.DataFrame, gripper: str, *, with_truth: bool = True
) -> list[TrainingData]:
    """Return the training data of each estimator that has outcomes with a gripper as principal.

    Parameters
    ----------
    inputs
        Estimates; its notes get which estimators are only supporters, and what is left out.
    outcomes
        As :func:`graspcast.estimates.outcomes.read_outcomes` returns them.
    gripper
        Its name.
    with_truth
        Whether to look up true poses, which the method blend needs; without them it is direct.

    Raises
    ------
    InputError
        If true poses are wanted and there are none.
    UnknownNameError
        For a gripper without outcomes.
    MismatchError
        If no instance has an outcome with it.
    """
    names = inputs.estimators
    out = []
    for name in names:
        estimates = inputs.estimates(name)
        truth = inputs.truth(estimates, name) if with_truth else None
        try:
            data = TrainingData.join(estimates, outcomes, name, gripper, truth=truth).of_grasp()
        except MismatchError as error:
            inputs.notes.append(f"{error}: it is only a supporter")
            continue
        if untried := int((~data.is_tried).sum()):
            inputs.notes.append(
                f"{counted(untried, 'instance', 'has', 'have')} no outcome of {name}"
            )
        out.append(data)
    if not out:
        raise MismatchError(
            f"no instance has an outcome of {', '.join(names)} with the {gripper} gripper; are the "
            "outcomes of the same dataset and scenes as the estimates?",
            parameters=("outcomes",),
        )
    return out


@dataclass(frozen=True, eq=False)
class PrincipalForecasts:
    """A principal's instances that have forecasts with every set of supporters.

    Attributes
    ----------
    principal
        Its name.
    supporters
        All of its supporters.
    forecasts
        By the supporters; the instances are the same.
    without_forecast
        Number of instances that were left out.
    tried
        Number of each instance among those of the principal that have outcomes, (n,).
    rows
        Dataset, scene, image and object to the row, where the image has one such instance only:
        with several, ``est_id`` 1 of two principals need not be the same instance.
    """

    principal: str
    supporters: tuple[str, ...]
    forecasts: Mapping[tuple[str, ...], Forecasts]
    without_forecast: int
    tried: Int[ndarray, " n"]
    rows: Mapping[tuple[str, int, int, int], int]

    @classmethod
    def of(
        cls, data: TrainingData, probability: Mapping[tuple[str, ...], Float[ndarray, " n"]]
    ) -> PrincipalForecasts:
        """Select the instances with forecasts.

        Parameters
        ----------
        data
            Of the principal.
        probability
            By the supporters, of each instance with an outcome; NaN without a forecast.

        Raises
        ------
        InputError
            If there is no forecast.
        """
        estimates = data.estimates
        tried = np.flatnonzero(data.is_tried)
        forecast = ~np.isnan(np.stack(list(probability.values()))).any(axis=0)
        if not forecast.any():
            raise InputError(
                f"there is no forecast for any instance of {data.principal}: each object was tried "
                "in a single fold of the scenes; give outcomes of more scenes",
                parameters=("outcomes", "folds"),
            )
        rows = tried[forecast]
        keys = [key[:4] for key in estimates.instances.to_keys()]
        several = {keys[i] for i in np.flatnonzero(estimates.est_id > 0)}
        forecasts = {
            names: Forecasts(
                protocol="unseen_scenes",
                method=f"with {', '.join(names)}",
                principal=data.principal,
                gripper=data.gripper,
                probability=found[forecast],
                success=data.own_success[rows] == 1,
                objects=estimates.objects[rows],
                scenes=scene_groups(estimates.instances)[rows],
            )
            for names, found in probability.items()
        }
        return cls(
            data.principal,
            estimates.supporters(data.principal),
            forecasts,
            int((~forecast).sum()),
            np.flatnonzero(forecast),
            {keys[row]: i for i, row in enumerate(rows) if keys[row] not in several},
        )

    @property
    def full(self) -> Forecasts:
        """The forecasts with all supporters."""
        return self.forecasts[self.supporters]


def forecast_principals(
    training_data: Sequence[TrainingData],
    *,
    progress: Progress | None = None,
    **options: Any,
) -> list[PrincipalForecasts]:
    """Cross-validate each principal with all supporters, without each, and with each alone.

    Parameters
    ----------
    training_data
        Of each principal.
    progress
        Called with the share that is done, from 0 to 1, and a short message.
    options
        Of :func:`graspcast.evaluation.cross_validation.cross_validated`.

    Raises
    ------
    InputError
        If a principal has no instance with a forecast.
    """
    for data in training_data:
        if len(data.estimates.estimators) < 2:
            raise InputError(
                "a consensus takes at least two estimators, but there is 1: give the results of "
                "another one too",
                parameters=("estimates",),
            )
    sets = [_supporter_sets(each.estimates.supporters(each.principal)) for each in training_data]
    total = sum(map(len, sets))
    done = 0
    candidates = []
    for data, wanted in zip(training_data, sets, strict=True):
        probability = {}
        for supporters in wanted:
            message = f"{data.principal} with {', '.join(supporters)}"
            step = step_of(progress, done, total, message)
            kept = [
                name
                for name in data.estimates.estimators
                if name == data.principal or name in supporters
            ]
            probability[supporters] = cross_validated(data.only(*kept), progress=step, **options)
            done += 1
        candidates.append(PrincipalForecasts.of(data, probability))
    return candidates


def _supporter_sets(supporters: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Return all supporters, all but each one, and each one alone, without duplicates."""
    sets = [supporters]
    if len(supporters) > 1:
        sets += [tuple(n for n in supporters if n != without) for without in supporters]
        sets += [(name,) for name in supporters]
    return list(dict.fromkeys(sets))


def common_rows(candidates: Sequence[PrincipalForecasts]) -> list[Int[ndarray, " m"]]:
    """Return the rows of each principal's that all principals have, in the same order."""
    shared = sorted(set.intersection(*(set(each.rows) for each in candidates)))
    return [np.array([each.rows[key] for key in shared], dtype=np.int64) for each in candidates]
