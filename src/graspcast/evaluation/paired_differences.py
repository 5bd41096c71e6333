"""Paired differences between the scores of two forecasts of the same instances.

Both forecasts are scored under the same draws of scenes (:mod:`graspcast.evaluation.bootstrap`), so
the interval of a difference reflects how the two differ, not how scenes differ.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.evaluation.bootstrap import Interval, ResampledScores, original_and_draws
from graspcast.evaluation.predictions import Forecasts

__all__ = [
    "CRITERION",
    "FORECAST_MEASURES",
    "PRINCIPAL_MEASURES",
    "PairedDifference",
    "ScoreDraws",
    "bootstrap_scores",
    "improvements",
    "original_scores",
]

_ATTEMPTED = ("success_at_50", "success_at_70", "success_at_90")
FORECAST_MEASURES = ("aurc", "auroc", "brier", *_ATTEMPTED)
"""By which sets of supporters are compared."""
PRINCIPAL_MEASURES = ("aurc", *_ATTEMPTED, "success")
"""By which principals are compared."""
CRITERION = "aurc"
"""The measure that decides which principal is recommended."""
_LOWER_IS_BETTER = ("aurc", "brier")

ScoreDraws = dict[str, Float[ndarray, " draws1"]]
"""Measure's name to its value on the original data, followed by its values on the draws."""


@dataclass(frozen=True)
class PairedDifference:
    """Scores of forecasts with some of the supporters, and the improvement by all of them.

    Attributes
    ----------
    scores
        Each of :data:`FORECAST_MEASURES`, with some of the supporters.
    improvement
        How much better each is with all supporters; positive is better in every measure.
    """

    scores: Mapping[str, float]
    improvement: Mapping[str, Interval]


def bootstrap_scores(
    forecasts: Forecasts, measures: Sequence[str], draws: int, seed: int
) -> ScoreDraws:
    """Score forecasts on the original data and on draws of scenes, if there are two or more.

    With the same scenes and seed, the draws are the same, so differences are paired.
    """
    scenes = np.unique(forecasts.scenes).tolist()
    resampled = ResampledScores(forecasts, scenes, original_and_draws(scenes, draws, seed))
    return {name: getattr(resampled, name)() for name in measures}


def original_scores(drawn: ScoreDraws) -> dict[str, float]:
    """Return the scores on the original data."""
    return {name: float(values[0]) for name, values in drawn.items()}


def improvements(better: ScoreDraws, worse: ScoreDraws) -> dict[str, Interval]:
    """Return the paired differences of scores, signed so that positive favours ``better``."""
    out = {}
    for name, values in better.items():
        lower = name in _LOWER_IS_BETTER
        difference = worse[name] - values if lower else values - worse[name]
        out[name] = Interval.of(difference[0], difference[1:])
    return out
