"""Intervals of the success rate of attempts over scenes, also where there are few scenes.

With many scenes the interval is that of the bootstrap over scenes
(:mod:`graspcast.evaluation.bootstrap`). Of fewer scenes a bootstrap is too narrow. There it
is an exact binomial one (Clopper and Pearson 1934) of fewer trials than there are:

- Where three scenes or more hold failures, and three or more successes, so that it can be seen how
  much scenes differ, as many trials as carry the same variance, with a further factor for the few
  degrees of freedom (Korn and Graubard 1998).
- Elsewhere, above all where no attempt fails, as if all grasps of a scene were one: with attempts
  a_u of scene u, Kish's effective number (sum a_u)^2 / sum a_u^2. That is wide enough however alike
  the grasps of a scene are.

References
----------
Kish (1965). Survey Sampling. Wiley.

Clopper and Pearson (1934). The use of confidence or fiducial limits illustrated in the case of the
binomial. Biometrika 26(4).

Zou and Donner (2008). Construction of confidence limits about effect measures: a general approach.
Statistics in Medicine 27(10).

Korn and Graubard (1998). Confidence intervals for proportions with small expected number of
positive counts estimated from survey data. Survey Methodology 24(2).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.special import betaincinv, stdtrit

from graspcast.evaluation.bootstrap import Interval

__all__ = ["FEW_SCENES", "difference_of", "drawn_interval", "success_interval"]

FEW_SCENES = 100
"""With attempts in fewer scenes the bootstrap is not used."""
_LEAST_EACH = 3
"""Nor where fewer scenes than this hold a failed attempt, or a successful one."""


def success_interval(
    attempted: Bool[ndarray, " n"],
    success: Float[ndarray, " n"] | Bool[ndarray, " n"],
    scene: Int[ndarray, " n"],
    counts: Int[ndarray, "draws1 scenes"],
    *,
    confidence: float = 0.95,
) -> Interval | None:
    """Return the success rate of attempts with its interval; None without attempts.

    Parameters
    ----------
    attempted, success
        Which instances are attempted, and which succeed (1) or would (0).
    scene
        Number of each instance's scene.
    counts
        How often each scene occurs, first in the data, then in each draw
        (:func:`~graspcast.evaluation.bootstrap.original_and_draws`).
    confidence
        Of the interval.
    """
    width = counts.shape[1]
    tried = np.bincount(scene[attempted], minlength=width).astype(np.float64)
    if not tried.any():
        return None
    held = np.bincount(scene, weights=attempted * np.asarray(success, float), minlength=width)
    some = tried > 0
    mixed = min(int((held > 0).sum()), int((held < tried).sum()))
    if some.sum() >= FEW_SCENES and mixed >= _LEAST_EACH:
        with np.errstate(invalid="ignore"):
            rate = (counts @ held) / (counts @ tried)
        return Interval.of(rate[0], rate[1:], (0.0, 1.0), confidence=confidence)
    size = _same_variance if mixed >= _LEAST_EACH else _one_each
    tried, held = tried[some], held[some]
    return _binomial(float(held.sum() / tried.sum()), size(tried, held, confidence), confidence)


def drawn_interval(
    attempted: Bool[ndarray, " n"],
    success: Float[ndarray, " n"] | Bool[ndarray, " n"],
    scene: Int[ndarray, " n"],
    counts: Int[ndarray, "draws1 scenes"],
) -> Interval | None:
    """Return the success rate of attempts with the 95 % interval by drawing scenes.

    Where all attempts succeed, or none, every draw has the same rate, however few attempts there
    are. There it is :func:`success_interval`.

    Parameters
    ----------
    attempted, success, scene, counts
        As for :func:`success_interval`.
    """
    width = counts.shape[1]
    tried = counts @ np.bincount(scene[attempted], minlength=width)
    held = counts @ np.bincount(scene, weights=attempted * success, minlength=width)
    if held[0] in (0, tried[0]):
        return success_interval(attempted, success, scene, counts)
    with np.errstate(invalid="ignore"):
        rate = held / tried
    return Interval.of(rate[0], rate[1:], (0.0, 1.0))


def difference_of(one: Interval, other: Interval) -> Interval:
    """Return a difference of two rates with its interval, from theirs (Zou and Donner 2008).

    It takes them for independent, so it is wide for rates of the same scenes. A single scene has no
    interval, and nor has a difference from its rate.
    """
    value = one.value - other.value
    below = np.hypot(one.value - one.low, other.high - other.value)
    above = np.hypot(one.high - one.value, other.value - other.low)
    return Interval(value, float(max(value - below, -1.0)), float(min(value + above, 1.0)))


def _one_each(tried: Float[ndarray, " k"], held: Float[ndarray, " k"], confidence: float) -> float:
    """Return the effective number of scenes."""
    return float(tried.sum() ** 2 / (tried**2).sum())


def _same_variance(
    tried: Float[ndarray, " k"], held: Float[ndarray, " k"], confidence: float
) -> float:
    """Return how many independent trials carry the variance that is seen between scenes."""
    scenes, trials = len(tried), float(tried.sum())
    rate = held.sum() / trials
    variance = scenes / (scenes - 1) * ((held - rate * tried) ** 2).sum() / trials**2
    tail = (1.0 + confidence) / 2.0
    few = (stdtrit(trials - 1, tail) / stdtrit(scenes - 1, tail)) ** 2
    return float(min(trials, rate * (1 - rate) / variance * few)) if variance > 0 else trials


def _binomial(rate: float, count: float, confidence: float) -> Interval:
    """Return the exact interval of a rate in so many trials, which may be a fraction."""
    tail = (1.0 - confidence) / 2.0
    k, rest = rate * count, (1.0 - rate) * count
    low = 0.0 if k == 0 else float(betaincinv(k, rest + 1.0, tail))
    high = 1.0 if rest == 0 else float(betaincinv(k + 1.0, rest, 1.0 - tail))
    return Interval(rate, low, high)
