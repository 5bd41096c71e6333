"""Scores of many weighted versions of the same predictions, for the bootstrap over scenes.

Trials of one scene resemble each other: neighbouring frames, the same table, the same light. So
scenes, not trials, are drawn with replacement (the cluster bootstrap: Davison & Hinkley 1997,
section 3.8; Field & Welsh 2007). A draw is a count for each scene. Nearly every score of a draw is
a product of the counts with sums that are taken once for each scene, so a thousand draws cost
little more than one; only the risk-coverage curve is walked through for each.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.scores import BINS, bin_of

__all__ = ["Interval", "Resampled", "draw_scenes", "every_scene_and_draws"]

_SHARES = (0.5, 0.7, 0.9)


def draw_scenes(scenes: Sequence[str], draws: int, seed: int) -> Int[ndarray, "draws scenes"]:
    """How often each scene occurs when as many as there are are drawn with replacement."""
    count = len(scenes)
    rng = np.random.default_rng(seed)
    return rng.multinomial(count, np.full(count, 1 / count), size=draws)


def every_scene_and_draws(
    scenes: Sequence[str], draws: int, seed: int
) -> Int[ndarray, "draws1 scenes"]:
    """Every scene once, and then :func:`draw_scenes`, if there are two scenes or more to draw."""
    once = np.ones((1, len(scenes)), dtype=np.int64)
    return np.concatenate([once, draw_scenes(scenes, draws, seed)]) if len(scenes) > 1 else once


@dataclass(frozen=True)
class Interval:
    """A figure and its 95 % interval; NaN where there are no two scenes to draw."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Float[ndarray, " draws1"]) -> Interval:
        """From the data's value and then each draw's; the undefined do not count."""
        drawn = values[1:][~np.isnan(values[1:])]
        low, high = np.percentile(drawn, (2.5, 97.5)) if len(drawn) else (np.nan, np.nan)
        return cls(float(values[0]), float(low), float(high))

    @property
    def distinct(self) -> bool:
        """Whether zero lies outside."""
        return self.low > 0 or self.high < 0

    def __format__(self, sign: str) -> str:
        value, low, high = (f"{x:{sign}.3f}" for x in (self.value, self.low, self.high))
        return value if self.low != self.low else f"{value} [{low}, {high}]"

    def __str__(self) -> str:
        return format(self)


class Resampled:
    """The scores of one method's forecasts when scenes count several times, or not at all.

    Every method answers for all draws at once, (draws,); NaN where a draw leaves a score undefined.
    They equal :func:`graspcast.evaluation.scores.score` on samples that are repeated so often.

    Parameters
    ----------
    forecasts
        The predictions.
    scenes
        The names of the scenes that counts are given for.
    counts
        How often each scene occurs in each draw, (draws, scenes).
    """

    def __init__(
        self, forecasts: Forecasts, scenes: Sequence[str], counts: Int[ndarray, "draws scenes"]
    ):
        self._forecasts = forecasts
        self._counts = counts.astype(np.float64)
        place = {name: i for i, name in enumerate(scenes)}
        self._scene: Int[ndarray, " n"] = np.array([place[name] for name in forecasts.scenes])
        self._width = len(scenes)
        self._sizes = self._total(np.ones(len(forecasts)))

    def _total(self, values: ndarray) -> Float[ndarray, " draws"]:
        """The sum of a value over the rows of each draw."""
        per_scene = np.bincount(self._scene, weights=values, minlength=self._width)
        return self._counts @ per_scene

    def _totals(self, values: ndarray, group: ndarray, groups: int) -> Float[ndarray, "draws g"]:
        """The same, for each group of rows apart."""
        per_scene = np.bincount(
            self._scene * groups + group, weights=values, minlength=self._width * groups
        ).reshape(self._width, groups)
        return self._counts @ per_scene

    def mean(self, values: Float[ndarray, " n"]) -> Float[ndarray, " draws"]:
        """The mean of a value over the rows."""
        with np.errstate(invalid="ignore"):
            return self._total(values) / self._sizes

    def accuracy(self) -> Float[ndarray, " draws"]:
        """At a probability of 0.5, averaged over the objects that occur in the draw."""
        f = self._forecasts
        right = ((f.probability >= 0.5) == f.success).astype(np.float64)
        names, number = np.unique(f.objects, return_inverse=True)
        sizes = self._totals(np.ones(len(right)), number, len(names))
        present = sizes > 0
        rate = np.divide(
            self._totals(right, number, len(names)), sizes, out=np.zeros_like(sizes), where=present
        )
        with np.errstate(invalid="ignore"):
            return rate.sum(axis=1) / present.sum(axis=1)

    def brier(self) -> Float[ndarray, " draws"]:
        """Mean squared difference of probability and outcome."""
        f = self._forecasts
        return self.mean((f.probability - f.success) ** 2)

    def ece(self) -> Float[ndarray, " draws"]:
        """Expected calibration error."""
        f = self._forecasts
        gaps = self._totals(f.probability - f.success, bin_of(f.probability), BINS)
        with np.errstate(invalid="ignore"):
            return np.abs(gaps).sum(axis=1) / self._sizes

    def success_in_bins(self) -> Float[ndarray, "draws bins"]:
        """Success rate of each bin of the calibration error."""
        f = self._forecasts
        number = bin_of(f.probability)
        with np.errstate(invalid="ignore"):
            return self._totals(f.success.astype(np.float64), number, BINS) / self._totals(
                np.ones(len(f)), number, BINS
            )

    def auroc(self) -> Float[ndarray, " draws"]:
        """Area under the ROC curve: the share of pairs of a success and a failure in order.

        How many of scene s's successes lie above scene t's failures does not depend on the draw.
        """
        f = self._forecasts
        won = np.empty((self._width, self._width))
        held, held_scene = f.probability[f.success], self._scene[f.success]
        for t in range(self._width):
            failed = np.sort(f.probability[~f.success & (self._scene == t)])
            below = np.searchsorted(failed, held, side="left")
            above = np.searchsorted(failed, held, side="right")
            won[:, t] = np.bincount(held_scene, weights=(below + above) / 2, minlength=self._width)
        pairs = self._total(f.success) * self._total(~f.success)
        ordered = np.einsum("ds,st,dt->d", self._counts, won, self._counts, optimize=True)
        with np.errstate(invalid="ignore"):
            return ordered / pairs

    def success(self) -> Float[ndarray, " draws"]:
        """Success rate of all rows."""
        return self.mean(self._forecasts.success.astype(np.float64))

    def success_at_50(self) -> Float[ndarray, " draws"]:
        """Success rate of the most probable half."""
        return 1 - self._curve[1][:, 0]

    def success_at_70(self) -> Float[ndarray, " draws"]:
        """Success rate of the most probable 70 %."""
        return 1 - self._curve[1][:, 1]

    def success_at_90(self) -> Float[ndarray, " draws"]:
        """Success rate of the most probable 90 %."""
        return 1 - self._curve[1][:, 2]

    def aurc(self) -> Float[ndarray, " draws"]:
        """Area under the risk-coverage curve."""
        return self._curve[0]

    @cached_property
    def _curve(self) -> tuple[Float[ndarray, " draws"], Float[ndarray, "draws shares"]]:
        """The area under the risk-coverage curve, and the risk at each of the shares."""
        f = self._forecasts
        order = np.argsort(-f.probability, kind="stable")
        last = np.append(np.diff(f.probability[order]) != 0, True)
        counts = self._counts.astype(np.int64)
        harmonic = np.concatenate([[0.0], np.cumsum(1 / np.arange(1, self._sizes.max() + 1))])
        # As RiskCoverage.success_at rounds: a half goes to the even neighbour.
        attempts = np.maximum(1, np.rint(np.outer(self._sizes, _SHARES)).astype(np.int64))
        return _walked()(counts, self._scene[order], ~f.success[order], last, harmonic, attempts)


@cache
def _walked() -> Callable[..., tuple[ndarray, ndarray]]:
    """Compiled when first used: loading numba takes longer than all the other scores."""
    from numba import njit

    # A checker of types at run time wraps functions, but cannot be compiled.
    compiled: Callable[..., tuple[ndarray, ndarray]] = njit(inspect.unwrap(_walk))
    return compiled


def _walk(
    counts: Int[ndarray, "draws scenes"],
    scene: Int[ndarray, " n"],
    failed: Bool[ndarray, " n"],
    last: Bool[ndarray, " n"],
    harmonic: Float[ndarray, " h"],
    attempts: Int[ndarray, "draws shares"],
) -> tuple[Float[ndarray, " draws"], Float[ndarray, "draws shares"]]:
    """The area of each draw, and the risk of its first attempts, rows by falling probability.

    Of m rows of equal probability, of which f fail, after M rows of which F failed, the j-th lies
    at risk (F + j f / m) / (M + j). Summed over j that is f + (F - M f / m) (H(M+m) - H(M)), H
    being the harmonic numbers.
    """
    areas = np.full(len(counts), np.nan)
    risks = np.full(attempts.shape, np.nan)
    for d in range(len(counts)):
        area = 0.0
        before = bad_before = count = bad = 0
        for i in range(len(scene)):
            weight = counts[d, scene[i]]
            count += weight
            if failed[i]:
                bad += weight
            if last[i] and count > 0:
                rest = bad_before - before * bad / count
                area += bad + rest * (harmonic[before + count] - harmonic[before])
                for k in range(attempts.shape[1]):
                    j = attempts[d, k] - before
                    if 0 < j <= count:
                        risks[d, k] = (bad_before + j * bad / count) / attempts[d, k]
                before += count
                bad_before += bad
                count = bad = 0
        if before > 0:
            areas[d] = area / before
    return areas, risks
