"""Exact binomial tests and confidence bounds of a success rate (Clopper-Pearson), and their power.

There is no normal approximation: bounds hold for any number of trials.

References
----------
Clopper and Pearson (1934). The use of confidence or fiducial limits illustrated in the case of the
binomial. Biometrika 26(4).

Bentkus (2004). On Hoeffding's inequalities. Annals of Probability 32(2).

Bates, Angelopoulos, Lei, Malik and Jordan (2021). Distribution-Free, Risk-Controlling Prediction
Sets. Journal of the ACM 68(6).
"""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.special import bdtr, betaincinv

__all__ = ["lower_bound", "mean_interval", "needed_trials", "p_value", "power"]


def p_value(successes: int, trials: int, rate: float) -> float:
    """Return the p-value of the one-sided exact binomial test of a success rate above ``rate``.

    It is P(X >= successes) for X ~ Binomial(trials, rate), and 1 without trials.
    """
    return float(bdtr(trials - successes, trials, 1.0 - rate)) if trials else 1.0


def lower_bound(successes: int, trials: int, confidence: float) -> float:
    """Return the one-sided lower confidence bound of a success rate (Clopper and Pearson 1934)."""
    if successes == 0:
        return 0.0
    return float(betaincinv(successes, trials - successes + 1, 1.0 - confidence))


def mean_interval(values: Float[ndarray, " n"], confidence: float) -> tuple[float, float]:
    """Return a two-sided confidence interval of the mean of independent values between 0 and 1.

    For values of 0 and 1 it is the Clopper-Pearson interval. For others the tail of the sum is at
    most e times the binomial one (Bentkus 2004; used as in Bates et al. 2021, section 3.1), so it
    is the same interval with the tail probability divided by e.

    Parameters
    ----------
    values
        From 0 to 1, (n,).
    confidence
        Of the interval.
    """
    n, total = len(values), float(values.sum())
    binary = bool(np.isin(values, (0.0, 1.0)).all())
    side = 1.0 - (1.0 - confidence) / 2.0 / (1.0 if binary else math.e)
    # Sums of fractions are rounded to whole counts in the direction that widens the interval.
    low = lower_bound(math.floor(total + 1e-9), n, side)
    high = 1.0 - lower_bound(math.floor(n - total + 1e-9), n, side)
    return low, high


def power(trials: int, true_rate: float, *, rate: float, confidence: float) -> float:
    """Return the probability that the test shows a rate of at least ``rate`` at ``true_rate``."""
    if trials < 1:
        return 0.0
    failures = np.arange(trials + 1)
    passes = int((bdtr(failures, trials, 1.0 - rate) <= 1.0 - confidence).sum())
    return float(bdtr(passes - 1, trials, 1.0 - true_rate)) if passes else 0.0


def needed_trials(
    observed: float, *, rate: float, confidence: float, max_trials: int = 10_000
) -> int | None:
    """Return the sample size at which the test shows ``rate`` if the success rate is ``observed``.

    The number of failures is rounded up. None if ``observed`` is not above ``rate``, or if more
    than ``max_trials`` are needed.
    """
    if observed <= rate:
        return None
    first, last = 1, 256
    while first <= max_trials:
        trials = np.arange(first, min(last, max_trials) + 1)
        failures = np.ceil((1.0 - observed) * trials - 1e-9)
        enough = bdtr(failures, trials, 1.0 - rate) <= 1.0 - confidence
        if enough.any():
            return int(trials[enough.argmax()])
        first, last = last + 1, last * 4
    return None
