"""On how many outcomes the forecasts of each grasp rest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from graspcast.forecasting.models.targets import Targets
from graspcast.forecasting.training_data import TrainingData

__all__ = ["FEW_OUTCOMES", "grasp_counts", "rarely_tried"]

FEW_OUTCOMES = 10
"""Outcomes below which a grasp is not preferred to one with more."""


def grasp_counts(data: TrainingData, targets: Targets) -> dict[str, dict[str, int]]:
    """Count the outcomes from which each grasp was learned.

    These are outcomes of the grasp whichever estimator guided it or, where there are none,
    simulated trials.

    Returns
    -------
        Object's name to grasp's name to the number of outcomes.
    """
    counts = np.zeros(len(targets), dtype=np.int64)
    names = data.objects.tolist()
    for grasp, success in zip(data.grasps, data.every_success, strict=True):
        numbers = targets.numbers(names, grasp)
        tried = (~np.isnan(success)).sum(axis=0)
        np.add.at(counts, numbers[numbers >= 0], tried[numbers >= 0])
    if data.simulated is not None:
        numbers = data.simulated.targets(targets)
        more = np.bincount(numbers[numbers >= 0], minlength=len(counts))
        counts = np.where(counts > 0, counts, more)
    given = iter(counts.tolist())
    return {
        name: {grasp: next(given) for grasp in grasps}
        for name, grasps in zip(targets.objects, targets.grasps, strict=True)
    }


def rarely_tried(counts: Mapping[str, Mapping[str, int]]) -> tuple[str, ...]:
    """Name the grasps that rest on few outcomes, in one sentence; nothing if there are none.

    Parameters
    ----------
    counts
        As :func:`grasp_counts` returns them.
    """
    few = [
        f"{grasp} of {name} ({n})"
        for name, some in counts.items()
        for grasp, n in some.items()
        if n < FEW_OUTCOMES
    ]
    if not few:
        return ()
    more = f" and {len(few) - 5} more" if len(few) > 5 else ""
    return (
        f"grasps with fewer than {FEW_OUTCOMES} outcomes come after all others: "
        f"{', '.join(few[:5])}{more}",
    )
