"""Exact statements about a success rate: Clopper-Pearson bounds, and how much data they need.

Nothing here is an approximation by a normal distribution: bounds hold for every number of trials.
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import bdtr, betaincinv

__all__ = ["lower_bound", "mean_interval", "needed_trials", "p_value", "power"]


def p_value(successes: int, trials: int, rate: float) -> float:
    """Chance of at least so many successes if the success rate were ``rate``, or less.

    Small values speak for a rate above ``rate``. Without trials it is 1.
    """
    return float(bdtr(trials - successes, trials, 1.0 - rate)) if trials else 1.0


def lower_bound(successes: int, trials: int, confidence: float) -> float:
    """Clopper and Pearson's (1934) one-sided lower bound on a success rate."""
    if successes == 0:
        return 0.0
    return float(betaincinv(successes, trials - successes + 1, 1.0 - confidence))


def mean_interval(values: Float[ndarray, "n"], confidence: float) -> tuple[float, float]:
    """A two-sided interval for the mean of independent values between 0 and 1.

    Values of 0 and 1 alone give Clopper and Pearson's interval. For others the tail of the sum is
    at most e times the binomial one (Bentkus 2004; as used by Bates et al. 2021, section 3.1), so
    it is the same interval with a tail e times as small.
    """
    n, total = len(values), float(values.sum())
    binary = bool(np.isin(values, (0.0, 1.0)).all())
    side = 1.0 - (1.0 - confidence) / 2.0 / (1.0 if binary else math.e)
    # Means of fractions are rounded to whole counts in the direction that widens the interval.
    low = lower_bound(math.floor(total + 1e-9), n, side)
    high = 1.0 - lower_bound(math.floor(n - total + 1e-9), n, side)
    return low, high


def power(trials: int, true_rate: float, *, rate: float, confidence: float) -> float:
    """Chance that so many trials show a rate of at least ``rate`` if it is ``true_rate``."""
    if trials < 1:
        return 0.0
    failures = np.arange(trials + 1)
    passes = int((bdtr(failures, trials, 1.0 - rate) <= 1.0 - confidence).sum())
    return float(bdtr(passes - 1, trials, 1.0 - true_rate)) if passes else 0.0


def needed_trials(
    observed: float, *, rate: float, confidence: float, most: int = 10_000
) -> int | None:
    """The fewest trials that show a rate of at least ``rate`` if ``observed`` is what they give.

    Failures are rounded up. None if ``observed`` is no higher than ``rate``, or by so little that
    ``most`` trials would not do.
    """
    if observed <= rate:
        return None
    first, last = 1, 256
    while first <= most:
        trials = np.arange(first, min(last, most) + 1)
        failures = np.ceil((1.0 - observed) * trials - 1e-9)
        enough = bdtr(failures, trials, 1.0 - rate) <= 1.0 - confidence
        if enough.any():
            return int(trials[enough.argmax()])
        first, last = last + 1, last * 4
    return None
