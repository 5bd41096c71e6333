"""Fall-off of success with the size of an error, estimated from few trials of chosen sizes.

The model is the log-logistic curve ``(1 - lapse) / (1 + (size / half)^slope)``. Its posterior is
kept on a grid, and each trial is made where the success rate is believed to be 50 or 90 %, by a
draw from the posterior, as thresholds of perception are measured (Watson and Pelli, *QUEST*, 1983;
Kontsevich and Tyler, *Bayesian adaptive estimation of psychometric slope and threshold*, 1999).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

__all__ = ["Bounds", "FallOff", "bounds_of", "measure_fall_off"]

LEVELS = (0.5, 0.9)
"""Success rates whose errors are looked for."""

_HALVES, _DRAWS = 200, 400
_SLOPES = np.array([1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 9.0, 14.0, 22.0, 40.0])
_LAPSES = np.array([0.0, 0.02, 0.04, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0])  # edges of cells
_SCAN = 7


class Bounds(NamedTuple):
    """A median of a posterior with its 90 % interval."""

    value: float
    low: float
    high: float


def bounds_of(values: Float[ndarray, " n"]) -> Bounds:
    """Return median, 5 % and 95 % quantile of draws from a posterior."""
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    return Bounds(float(middle), float(low), float(high))


class FallOff:
    """How success falls with the size of an error, as a posterior over curves.

    Parameters
    ----------
    limit
        The largest size of an error that is tried.
    held, of
        Successes and trials without an error of this kind, which say how often a trial fails
        whatever its size.

    Attributes
    ----------
    limit
        The largest size of an error that is tried.
    trials
        Number of trials so far.
    """

    def __init__(self, limit: float, *, held: int = 0, of: int = 0):
        from scipy.stats import beta

        self.limit, self.trials = limit, 0
        half = limit * np.geomspace(1 / 400, 4, _HALVES)
        lapse = (_LAPSES[:-1] + _LAPSES[1:]) / 2
        grid = np.meshgrid(np.log(half), _SLOPES, lapse, indexing="ij")
        self._log_half, self._slope, self._lapse = (part.ravel() for part in grid)
        # Jeffreys' prior of the lapse, updated by the trials without an error.
        cells = np.diff(beta.cdf(_LAPSES, 0.5 + of - held, 0.5 + held))
        prior = np.broadcast_to(np.log(np.maximum(cells, 1e-300)), grid[0].shape)
        self._log_weight = prior.ravel().copy()

    def add(self, size: float, *, success: bool) -> None:
        """Add the outcome of a trial."""
        rate = self._rates(np.array([size]), slice(None))[:, 0]
        self._log_weight += np.log(np.maximum(rate if success else 1 - rate, 1e-12))
        self._log_weight -= self._log_weight.max()
        self.trials += 1

    def crossing(self, level: float) -> Bounds:
        """Return the size at which the success rate falls to a level, at most ``limit``."""
        return bounds_of(np.minimum(self._crossings(level, self.draws()), self.limit))

    def draws(self) -> ndarray:
        """Draw curves from the posterior, always the same ones, for :meth:`rates`."""
        weight = np.exp(self._log_weight)
        cumulative = np.cumsum(weight / weight.sum())
        # Systematic draws: evenly spaced through the distribution.
        places = (np.arange(_DRAWS) + 0.5) / _DRAWS
        return np.minimum(np.searchsorted(cumulative, places), len(cumulative) - 1)

    def rates(self, sizes: Float[ndarray, " s"]) -> Float[ndarray, "d s"]:
        """Return the success rates of the curves of :meth:`draws` at sizes."""
        return self._rates(sizes, self.draws())

    def next_size(self, level: float, rng: np.random.Generator) -> float:
        """Return the size to try next: where one curve of the posterior has a success rate."""
        draw = rng.choice(self.draws(), 1)
        return float(np.clip(self._crossings(level, draw)[0], self.limit / 400, self.limit))

    def _rates(self, sizes: Float[ndarray, " s"], rows: ndarray | slice) -> Float[ndarray, "g s"]:
        away = np.log(np.maximum(sizes, 1e-12))[None] - self._log_half[rows, None]
        steep = np.clip(away * self._slope[rows, None], -60, 60)
        return np.asarray((1 - self._lapse[rows])[:, None] / (1 + np.exp(steep)))

    def _crossings(self, level: float, rows: ndarray) -> Float[ndarray, " d"]:
        above = (1 - self._lapse[rows]) / level - 1
        size = np.exp(self._log_half[rows] + np.log(np.maximum(above, 1e-12)) / self._slope[rows])
        return np.where(above > 0, size, 0.0)


def measure_fall_off(
    tried: Callable[[float], bool],
    limit: float,
    trials: int,
    rng: np.random.Generator,
    *,
    held: int = 0,
    of: int = 0,
) -> FallOff:
    """Measure how success falls with the size of an error, from the smallest outwards.

    Sizes are doubled until two trials in a row fail, so that what would succeed again farther away,
    as a quarter turn of a cube does, is never reached. The other trials are made below that.

    Parameters
    ----------
    tried
        Runs a trial with an error of a size and returns whether it succeeds.
    limit
        The largest size.
    trials
        Number of trials.
    rng
        Source of random numbers.
    held, of
        As for :class:`FallOff`.
    """
    curve = FallOff(limit, held=held, of=of)
    failed = 0
    for size in (limit * 0.5 ** np.arange(_SCAN - 1, -1, -1)).tolist():
        success = tried(size)
        curve.add(size, success=success)
        failed = 0 if success else failed + 1
        if failed == 2 or curve.trials >= trials:
            break
    reached = size
    while curve.trials < trials:
        level = LEVELS[curve.trials % len(LEVELS)]
        size = min(curve.next_size(level, rng), reached)
        curve.add(size, success=tried(size))
    return curve
