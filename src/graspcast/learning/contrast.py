"""Two ways to forecast the same instances, and by how much one is better, with its uncertainty.

Differences are paired: the same instances under the same draws of scenes with replacement (cluster
bootstrap: Davison & Hinkley, *Bootstrap Methods and their Application*, 1997, 3.8), since instances
of one scene are not independent.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.learning.scores import score

__all__ = [
    "DECISIVE",
    "FORECAST",
    "STANDING",
    "Contrast",
    "Drawn",
    "Gain",
    "draw_rows",
    "figures_of",
    "gains",
    "under_draws",
]

_ATTEMPTED = ("success_at_50", "success_at_70", "success_at_90")
FORECAST = ("aurc", "auroc", "brier", *_ATTEMPTED)
"""Measures of what supporters are worth."""
STANDING = ("aurc", *_ATTEMPTED, "success")
"""Measures of what grasps a principal guides; all attempted is the last."""
DECISIVE = "aurc"
"""The measure by which the recommendation is made."""
_LOWER_IS_BETTER = ("aurc", "brier")
_LEVEL = (2.5, 97.5)

Drawn = dict[str, Float[ndarray, "b"]]
"""Of each measure its value, and then its value under each draw of scenes."""


@dataclass(frozen=True)
class Gain:
    """By how much something is better than something else: positive is better in every measure.

    Attributes:
        value: The difference.
        low, high: Its 95 % interval; NaN where there are no two scenes to draw.
    """

    value: float
    low: float
    high: float

    @property
    def distinct(self) -> bool:
        """Whether zero lies outside the interval."""
        return self.low > 0 or self.high < 0

    def __str__(self) -> str:
        return f"{self.value:+.3f} [{self.low:+.3f}, {self.high:+.3f}]"


@dataclass(frozen=True)
class Contrast:
    """Forecasts with some of the supporters, and how much better they are with all.

    Attributes:
        figures: Each of :data:`FORECAST`.
        gain: By how much all supporters do better than these.
    """

    figures: Mapping[str, float]
    gain: Mapping[str, Gain]


def draw_rows(groups: ndarray, bootstrap: int, seed: int) -> list[Int[ndarray, "m"]]:
    """Rows of scenes drawn with replacement; none where there are no two scenes."""
    names, number = np.unique(groups, return_inverse=True)
    if len(names) < 2:
        return []
    rows = [np.flatnonzero(number == i) for i in range(len(names))]
    chosen = np.random.default_rng(seed).integers(len(names), size=(bootstrap, len(names)))
    return [np.concatenate([rows[i] for i in one]) for one in chosen.tolist()]


def under_draws(
    probability: Float[ndarray, "n"],
    success: Bool[ndarray, "n"],
    draws: Sequence[Int[ndarray, "m"]],
    measures: Sequence[str],
) -> Drawn:
    """Measures of all instances, and of each draw of rows."""
    together = np.zeros(len(success), dtype=np.int64)  # accuracy, over objects, is not asked for
    found = [
        score(probability[rows], success[rows], together[rows])
        for rows in (np.arange(len(success)), *draws)
    ]
    return {name: np.array([getattr(one, name) for one in found]) for name in measures}


def figures_of(drawn: Drawn) -> dict[str, float]:
    """The measures of all instances."""
    return {name: float(values[0]) for name, values in drawn.items()}


def gains(mine: Drawn, other: Drawn) -> dict[str, Gain]:
    """By how much one is better than another, in each measure."""
    out = {}
    for name, values in mine.items():
        better = (other[name] - values) if name in _LOWER_IS_BETTER else (values - other[name])
        under = better[1:][~np.isnan(better[1:])]  # a draw with one class has no AUROC
        low, high = np.percentile(under, _LEVEL) if len(under) else (np.nan, np.nan)
        out[name] = Gain(float(better[0]), float(low), float(high))
    return out
