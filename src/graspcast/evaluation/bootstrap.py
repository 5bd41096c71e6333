"""Cluster bootstrap over scenes: confidence intervals, and scores of all draws at once.

Trials of one scene are correlated: neighbouring frames, the same table, the same light. So scenes,
not trials, are drawn with replacement. A draw is a count for each scene. Nearly every score of a
draw is a product of the counts with sums that are computed once for each scene, so a thousand draws
cost little more than one; only the risk-coverage curve needs a pass over the rows for each.

References
----------
Efron and Tibshirani (1993). An Introduction to the Bootstrap. Chapman & Hall.

Davison and Hinkley (1997). Bootstrap Methods and their Application, section 3.8. Cambridge
University Press.

Field and Welsh (2007). Bootstrapping clustered data. Journal of the Royal Statistical Society B
69(3).
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

__all__ = ["Bootstrap", "Interval", "ResampledScores", "draw_scenes", "original_and_draws"]

_SHARES = (0.5, 0.7, 0.9)


@dataclass(frozen=True)
class Bootstrap:
    """Settings of the bootstrap.

    Attributes
    ----------
    draws
        Number of draws of scenes.
    seed
        Of the draws.
    confidence
        Of the intervals.
    """

    draws: int = 1000
    seed: int = 0
    confidence: float = 0.95


def draw_scenes(scenes: Sequence[str], draws: int, seed: int) -> Int[ndarray, "draws scenes"]:
    """Draw as many scenes as there are, with replacement, and return how often each occurs."""
    count = len(scenes)
    rng = np.random.default_rng(seed)
    return rng.multinomial(count, np.full(count, 1 / count), size=draws)


def original_and_draws(
    scenes: Sequence[str], draws: int, seed: int
) -> Int[ndarray, "draws1 scenes"]:
    """Return counts of 1 for the original data, and below them those of :func:`draw_scenes`.

    A single scene cannot be resampled, so for it there are no draws.
    """
    once = np.ones((1, len(scenes)), dtype=np.int64)
    return np.concatenate([once, draw_scenes(scenes, draws, seed)]) if len(scenes) > 1 else once


@dataclass(frozen=True)
class Interval:
    """An estimate and its bootstrap confidence interval.

    Attributes
    ----------
    value
        The estimate; NaN where it is undefined.
    low, high
        Ends of the interval; NaN where no draw or the estimate is defined.
    """

    value: float
    low: float
    high: float

    @classmethod
    def of(
        cls,
        value: float,
        draws: Float[ndarray, " draws"],
        limits: tuple[float, float] = (-np.inf, np.inf),
        *,
        confidence: float = 0.95,
    ) -> Interval:
        """Return the bias-corrected percentile interval.

        Its ends are percentiles of the draws, minus the bootstrap estimate of bias: the mean of the
        draws minus the estimate (Efron and Tibshirani 1993, chapter 10). Some scores are biased in
        a draw, which repeats some scenes and lacks others; the calibration error, for example, is
        too large.

        Parameters
        ----------
        value
            The estimate on the data.
        draws
            The estimate on each draw; NaN where it is undefined, which is left out, (draws,).
        limits
            The range of possible values, to which the ends are clipped.
        confidence
            Of the interval.
        """
        value = float(value)
        defined = draws[~np.isnan(draws)]
        if not len(defined) or np.isnan(value):
            return cls(value, np.nan, np.nan)
        tail = (1 - confidence) / 2
        ends = np.quantile(defined, [tail, 1 - tail]) - (defined.mean() - value)
        low, high = np.clip(ends, *limits).tolist()
        return cls(value, low, high)

    @property
    def excludes_zero(self) -> bool:
        """Whether zero lies outside."""
        return self.low > 0 or self.high < 0

    @property
    def ends(self) -> list[float] | None:
        """Both ends, for JSON; None if they are undefined."""
        return None if np.isnan(self.low) else [self.low, self.high]

    def __format__(self, sign: str) -> str:
        value, low, high = (f"{x:{sign}.3f}" for x in (self.value, self.low, self.high))
        return value if np.isnan(self.low) else f"{value} [{low}, {high}]"

    def __str__(self) -> str:
        return format(self)


class ResampledScores:
    """The scores of one method's forecasts under many counts of scenes.

    Every method returns the scores of all draws at once, (draws,); NaN where a draw leaves a score
    undefined. They equal :func:`graspcast.evaluation.scores.score` on the rows of the draw, those
    of a scene repeated as often as it was drawn.

    Parameters
    ----------
    forecasts
        The predictions.
    scenes
        Names of the scenes, in the order of the counts.
    counts
        How often each scene occurs in each draw, (draws, scenes).
    """

    def __init__(
        self, forecasts: Forecasts, scenes: Sequence[str], counts: Int[ndarray, "draws scenes"]
    ):
        self._forecasts = forecasts
        self._counts = counts.astype(np.float64)
        column = {name: i for i, name in enumerate(scenes)}
        self._scene: Int[ndarray, " n"] = np.array([column[name] for name in forecasts.scenes])
        self._width = len(scenes)
        self._sizes = self._sum(np.ones(len(forecasts)))

    def _sum(self, values: ndarray) -> Float[ndarray, " draws"]:
        """Return the sum of a value over the rows of each draw."""
        per_scene = np.bincount(self._scene, weights=values, minlength=self._width)
        return self._counts @ per_scene

    def _group_sums(
        self, values: ndarray, group: ndarray, groups: int
    ) -> Float[ndarray, "draws groups"]:
        """Return the sum over the rows of each group in each draw."""
        per_scene = np.bincount(
            self._scene * groups + group, weights=values, minlength=self._width * groups
        ).reshape(self._width, groups)
        return self._counts @ per_scene

    def mean(self, values: Float[ndarray, " n"]) -> Float[ndarray, " draws"]:
        """Return the mean of a value over the rows."""
        with np.errstate(invalid="ignore"):
            return self._sum(values) / self._sizes

    def accuracy(self) -> Float[ndarray, " draws"]:
        """Return the accuracy at a probability of 0.5, averaged over the objects in the draw."""
        f = self._forecasts
        right = ((f.probability >= 0.5) == f.success).astype(np.float64)
        names, number = np.unique(f.objects, return_inverse=True)
        sizes = self._group_sums(np.ones(len(right)), number, len(names))
        present = sizes > 0
        rate = np.divide(
            self._group_sums(right, number, len(names)),
            sizes,
            out=np.zeros_like(sizes),
            where=present,
        )
        with np.errstate(invalid="ignore"):
            return rate.sum(axis=1) / present.sum(axis=1)

    def brier(self) -> Float[ndarray, " draws"]:
        """Return the Brier score."""
        f = self._forecasts
        return self.mean((f.probability - f.success) ** 2)

    def ece(self) -> Float[ndarray, " draws"]:
        """Return the expected calibration error."""
        f = self._forecasts
        gaps = self._group_sums(f.probability - f.success, bin_of(f.probability), BINS)
        with np.errstate(invalid="ignore"):
            return np.abs(gaps).sum(axis=1) / self._sizes

    def success_in_bins(self) -> Float[ndarray, "draws bins"]:
        """Return the success rate in each bin of the calibration error."""
        f = self._forecasts
        number = bin_of(f.probability)
        with np.errstate(invalid="ignore"):
            return self._group_sums(f.success.astype(np.float64), number, BINS) / self._group_sums(
                np.ones(len(f)), number, BINS
            )

    def auroc(self) -> Float[ndarray, " draws"]:
        """Return the area under the ROC curve: the share of correctly ordered pairs.

        The number of pairs of a success in scene s and a failure in scene t that are in order does
        not depend on the draw.
        """
        f = self._forecasts
        ordered = np.empty((self._width, self._width))
        succeeded, scene = f.probability[f.success], self._scene[f.success]
        for t in range(self._width):
            failed = np.sort(f.probability[~f.success & (self._scene == t)])
            below = np.searchsorted(failed, succeeded, side="left")
            not_above = np.searchsorted(failed, succeeded, side="right")
            ordered[:, t] = np.bincount(
                scene, weights=(below + not_above) / 2, minlength=self._width
            )
        pairs = self._sum(f.success) * self._sum(~f.success)
        total = np.einsum("ds,st,dt->d", self._counts, ordered, self._counts, optimize=True)
        with np.errstate(invalid="ignore"):
            return total / pairs

    def success(self) -> Float[ndarray, " draws"]:
        """Return the success rate of all rows."""
        return self.mean(self._forecasts.success.astype(np.float64))

    def success_at_50(self) -> Float[ndarray, " draws"]:
        """Return the success rate of the half with the highest probabilities."""
        return 1 - self._risk_coverage[1][:, 0]

    def success_at_70(self) -> Float[ndarray, " draws"]:
        """Return the success rate of the 70 % with the highest probabilities."""
        return 1 - self._risk_coverage[1][:, 1]

    def success_at_90(self) -> Float[ndarray, " draws"]:
        """Return the success rate of the 90 % with the highest probabilities."""
        return 1 - self._risk_coverage[1][:, 2]

    def aurc(self) -> Float[ndarray, " draws"]:
        """Return the area under the risk-coverage curve."""
        return self._risk_coverage[0]

    @cached_property
    def _risk_coverage(self) -> tuple[Float[ndarray, " draws"], Float[ndarray, "draws shares"]]:
        """The area under the risk-coverage curve, and the risk at each of the shares."""
        f = self._forecasts
        order = np.argsort(-f.probability, kind="stable")
        last = np.append(np.diff(f.probability[order]) != 0, True)
        counts = self._counts.astype(np.int64)
        harmonic = np.concatenate([[0.0], np.cumsum(1 / np.arange(1, self._sizes.max() + 1))])
        # As RiskCoverage.success_at rounds: a half goes to the even neighbour.
        attempts = np.maximum(1, np.rint(np.outer(self._sizes, _SHARES)).astype(np.int64))
        compiled = _compiled_areas_and_risks()
        return compiled(counts, self._scene[order], ~f.success[order], last, harmonic, attempts)


@cache
def _compiled_areas_and_risks() -> Callable[..., tuple[ndarray, ndarray]]:
    """Compile when first used: loading numba takes longer than all other scores."""
    from numba import njit

    # Type checks at run time wrap functions, and the wrapper cannot be compiled.
    compiled: Callable[..., tuple[ndarray, ndarray]] = njit(inspect.unwrap(_areas_and_risks))
    return compiled


def _areas_and_risks(  # pragma: no cover - compiled by Numba
    counts: Int[ndarray, "draws scenes"],
    scene: Int[ndarray, " n"],
    failed: Bool[ndarray, " n"],
    last: Bool[ndarray, " n"],
    harmonic: Float[ndarray, " h"],
    attempts: Int[ndarray, "draws shares"],
) -> tuple[Float[ndarray, " draws"], Float[ndarray, "draws shares"]]:
    """Return each draw's AURC, and the risk of its first attempts, rows by falling probability.

    Of m rows of equal probability, of which f fail, after M rows of which F failed, the j-th lies
    at risk (F + j f / m) / (M + j). Summed over j that is f + (F - M f / m) (H(M+m) - H(M)), where
    H are the harmonic numbers.
    """
    areas = np.full(len(counts), np.nan)
    risks = np.full(attempts.shape, np.nan)
    for d in range(len(counts)):
        area = 0.0
        rows_before = failures_before = rows = failures = 0
        for i in range(len(scene)):
            weight = counts[d, scene[i]]
            rows += weight
            if failed[i]:
                failures += weight
            if last[i] and rows > 0:
                rest = failures_before - rows_before * failures / rows
                area += failures + rest * (harmonic[rows_before + rows] - harmonic[rows_before])
                for k in range(attempts.shape[1]):
                    j = attempts[d, k] - rows_before
                    if 0 < j <= rows:
                        risks[d, k] = (failures_before + j * failures / rows) / attempts[d, k]
                rows_before += rows
                failures_before += failures
                rows = failures = 0
        if rows_before > 0:
            areas[d] = area / rows_before
    return areas, risks
