"""Two ways to forecast the same instances, and by how much one is better, with its uncertainty.

Differences are paired: the same instances under the same draws of scenes with replacement
(:mod:`graspcast.evaluation.bootstrap`), since instances of one scene are not independent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.evaluation.bootstrap import Interval, Resampled, every_scene_and_draws
from graspcast.evaluation.predictions import Forecasts

__all__ = [
    "DECISIVE",
    "FORECAST",
    "STANDING",
    "Drawn",
    "PairedDifference",
    "figures_of",
    "gains",
    "under_scenes",
]

_ATTEMPTED = ("success_at_50", "success_at_70", "success_at_90")
FORECAST = ("aurc", "auroc", "brier", *_ATTEMPTED)
"""Measures of what supporters are worth."""
STANDING = ("aurc", *_ATTEMPTED, "success")
"""Measures of what grasps a principal guides; all attempted is the last."""
DECISIVE = "aurc"
"""The measure by which the recommendation is made."""
_LOWER_IS_BETTER = ("aurc", "brier")

Drawn = dict[str, Float[ndarray, "b"]]
"""Of each measure its value, and then its value under each draw of scenes."""


@dataclass(frozen=True)
class PairedDifference:
    """Forecasts with some of the supporters, and how much better they are with all.

    Attributes
    ----------
    figures
        Each of :data:`FORECAST`.
    gain
        By how much all supporters do better than these.
    """

    figures: Mapping[str, float]
    gain: Mapping[str, Interval]


def under_scenes(forecasts: Forecasts, measures: Sequence[str], bootstrap: int, seed: int) -> Drawn:
    """Measures of all instances, and under draws of their scenes, if there are two or more.

    Forecasts of the same scenes share the draws of a seed, which pairs what they differ by.
    """
    scenes = np.unique(forecasts.scenes).tolist()
    again = Resampled(forecasts, scenes, every_scene_and_draws(scenes, bootstrap, seed))
    return {name: getattr(again, name)() for name in measures}


def figures_of(drawn: Drawn) -> dict[str, float]:
    """The measures of all instances."""
    return {name: float(values[0]) for name, values in drawn.items()}


def gains(mine: Drawn, other: Drawn) -> dict[str, Interval]:
    """By how much one is better than another: positive is better in every measure."""
    out = {}
    for name, values in mine.items():
        better = (other[name] - values) if name in _LOWER_IS_BETTER else (values - other[name])
        out[name] = Interval.of(better)
    return out
