"""Scope of training: what of the training data a method uses, and which grasps it learns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspcast.errors import InputError
from graspcast.forecasting.models.targets import Targets
from graspcast.forecasting.one_estimator import check_alone
from graspcast.forecasting.training_data import TrainingData

__all__ = ["FOREST_METHODS", "LEAST", "Scope", "scope_of"]

LEAST = 10
"""Outcomes below which nothing is learned."""
FOREST_METHODS = {"blend": None, "two-stage": 0.0, "direct": 1.0}
"""Methods made of forests, and the weight of the direct forest if not that of the settings."""


@dataclass(frozen=True, eq=False)
class Scope:
    """The training data that a method uses, and the objects that it learns.

    Attributes
    ----------
    data
        All instances, or for methods that use the principal's outcomes alone, the tried ones.
    targets
        The objects that can be forecast, and their grasps.
    simulated
        Those of the objects that have simulated trials alone.
    """

    data: TrainingData
    targets: Targets
    simulated: tuple[str, ...] = ()


def scope_of(data: TrainingData, method: str) -> Scope:
    """Select what a method can learn from.

    Parameters
    ----------
    data
        The training data.
    method
        Of the forecaster.

    Raises
    ------
    InputError
        If that is too little.
    """
    from_forests = method in FOREST_METHODS
    if data.views is None or not from_forests:
        check_alone(data, method)
    if data.simulated is not None and not from_forests and not data.is_tried.any():
        raise InputError(
            f"the method {method} does not learn from simulated trials, and there are no other "
            f"outcomes; {', '.join(FOREST_METHODS)} do",
            parameters=("method", "simulated"),
        )
    if not data.has_truth.any() and (method == "two-stage" or data.simulated is not None):
        raise InputError(
            "the method two-stage, and simulated trials with any method, need ground truth, but no "
            "instance has a known true pose",
            parameters=("ground_truth", "bop", "method", "simulated"),
        )
    simulated: set[tuple[str, str]] = set()
    if from_forests and data.simulated is not None:
        simulated = data.simulated.pairs
    is_tried = data.is_tried
    own = data.own_outcomes
    tried, successes = int((~np.isnan(own)).sum()), int((own == 1).sum())
    if not simulated and (tried < LEAST or successes in (0, tried)):
        raise InputError(
            f"{tried} outcomes of {data.principal} with {successes} successes are too few to learn "
            "from: give at least ten, with both successes and failures",
            parameters=("outcomes",),
        )
    if not from_forests:
        data.refuse_several(
            f"the method {method} forecasts the reference grasp of each object alone; blend "
            "forecasts several",
            "method",
            "outcomes",
        )
        data = data.select(is_tried)
        return Scope(data, Targets.of_objects(sorted(set(data.objects.tolist()))))
    with_outcomes = ~np.isnan(data.every_success).all(axis=1)
    if method == "two-stage":
        with_outcomes &= data.has_truth
    if data.learned is not None:
        with_outcomes |= data.learned.usable(data.truth).any(axis=0)
    known = {
        (name, grasp)
        for grasp, tried_so in zip(data.grasps, with_outcomes, strict=True)
        for name in data.objects[tried_so].tolist()
    }
    untried = {name for name, _ in simulated} - {name for name, _ in known}
    return Scope(data, Targets.of(known | simulated), tuple(sorted(untried)))
