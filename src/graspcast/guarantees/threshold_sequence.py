"""In which order thresholds are tested: the fixed sequence of Learn-then-Test.

A sequence must not depend on the data that it is tested on, nor may the place where testing starts
be chosen by looking at how many of the calibration data reach it. So there are two sequences: one
that depends on no data, and one that other data (the training's out-of-fold forecasts) have taught.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.guarantees.binomial import power

__all__ = [
    "ThresholdSequence",
    "UnitShares",
    "check_target",
    "default_sequence",
    "explore",
    "learn_sequence",
]


@dataclass(frozen=True)
class ThresholdSequence:
    """Thresholds from strict to permissive, and where testing starts.

    The error that is allowed in all, 1 - confidence, is dealt out by ``weights``. A threshold is
    tested with its own part and with all that the one before it was certified with; one that fails
    passes nothing on. That is Wiens' (2003) fallback procedure: the chance of certifying anything
    false is at most the sum, however the tests depend on one another. With all weight on one
    threshold it is the fixed sequence of Angelopoulos et al. (2021) that starts there.

    Attributes
    ----------
    thresholds
        Descending probabilities.
    weights
        One for each threshold, not negative, summing to 1.
    source
        What it was fixed on, in words.
    """

    thresholds: tuple[float, ...]
    weights: tuple[float, ...]
    source: str

    def __post_init__(self) -> None:
        steps = np.diff(self.thresholds)
        inside = all(0.0 <= t <= 1.0 for t in self.thresholds)
        if not self.thresholds or not inside or (steps >= 0).any():
            raise InputError("a sequence needs descending thresholds between 0 and 1")
        total = abs(sum(self.weights) - 1.0)
        if len(self.weights) != len(self.thresholds) or min(self.weights) < 0 or total > 1e-9:
            raise InputError(
                "a sequence needs one weight for each threshold, none negative, that sum to 1"
            )

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> ThresholdSequence:
        """What :meth:`as_dict` gave.

        Raises
        ------
        KeyError, TypeError, ValueError, InputError
            If it is something else.
        """
        thresholds = tuple(float(t) for t in content["thresholds"])
        weights = tuple(float(w) for w in content["weights"])
        return cls(thresholds, weights, str(content["source"]))


def check_target(name: str, value: float) -> None:
    """Refuse a rate or a confidence that nothing, or only certainty, could reach.

    Raises
    ------
    InputError
        If it is not above 0 and below 1.
    """
    if not 0.0 < value < 1.0:
        raise InputError(f"the {name} should be above 0 and below 1, not {value}")


def default_sequence(rate: float) -> ThresholdSequence:
    """Steps of a hundredth, downwards; testing starts at the target rate, and on either side of it.

    A calibrated forecaster keeps a promise of ``rate`` at the threshold ``rate``, and at no
    threshold that can be named without data does it attempt more. Half of the allowed error is
    spent there. A quarter is spent half-way from there to 1, for forecasters that promise too much,
    and a quarter at 2 rate - 1 (0.8 for 0.9), for those that promise too little.
    """
    check_target("rate", rate)
    above, below = (1.0 + rate) / 2.0, max(2.0 * rate - 1.0, rate / 2.0)
    starts = {rate: 0.5, round(above, 9): 0.25, round(below, 9): 0.25}
    grid = {step / 100.0 for step in range(1, 100)}.union(starts)
    thresholds = tuple(sorted(grid, reverse=True))
    return ThresholdSequence(thresholds, tuple(starts.get(t, 0.0) for t in thresholds), "no data")


@dataclass(frozen=True, eq=False)
class UnitShares:
    """What each unit holds at one threshold.

    Attributes
    ----------
    attempted
        Share of the unit's trials that are attempted, (units,).
    succeeded
        Share of these that succeed; NaN where none is attempted, (units,).
    size
        The unit's trials, as a share of those of the largest, (units,).
    """

    attempted: Float[ndarray, "units"]
    succeeded: Float[ndarray, "units"]
    size: Float[ndarray, "units"]

    @classmethod
    def at(
        cls,
        threshold: float,
        probability: Float[ndarray, "n"],
        success: Bool[ndarray, "n"],
        number: Int[ndarray, "n"],
    ) -> UnitShares:
        """Count attempts and successes by unit; units are numbered from 0, none left out."""
        attempt = probability >= threshold
        size = np.bincount(number)
        attempts = np.bincount(number[attempt], minlength=len(size))
        held = np.bincount(number[attempt & success], minlength=len(size))
        succeeded = np.full(len(size), np.nan)
        np.divide(held, attempts, out=succeeded, where=attempts > 0)
        return cls(attempts / size, succeeded, size / size.max())

    def evidence(self, weight: str) -> tuple[float, float]:
        """How many of one's units bear evidence, and at which success rate.

        Returns
        -------
            The expected share of units with a drawn attempt, and that attempt's success rate (NaN
            without attempts); the draw is explained in :mod:`graspcast.guarantees.certify`.
        """
        some = ~np.isnan(self.succeeded)
        if not some.any():
            return 0.0, float("nan")
        if weight == "unit":
            return float(some.mean()), float(self.succeeded[some].mean())
        share = self.size * self.attempted
        held = float((share[some] * self.succeeded[some]).sum() / share[some].sum())
        return float(share.mean()), held


def learn_sequence(
    probability: Float[ndarray, "n"],
    success: Bool[ndarray, "n"],
    units: ndarray,
    *,
    rate: float,
    confidence: float,
    calibration_units: int,
    weight: str = "attempt",
    steps: int = 50,
) -> ThresholdSequence:
    """A sequence of quantiles that starts where other data say that it will most likely pass.

    Parameters
    ----------
    probability
        Forecasts for data that are *not* the calibration data and that the forecaster was not
        trained on: out-of-fold forecasts of its training data.
    success
        Their outcomes.
    units
        Their scenes or images.
    rate
        The target.
    confidence
        Of the promise.
    calibration_units
        How many units the calibration data will have.
    weight
        As for :func:`graspcast.certify`.
    steps
        How many quantiles there are.

    A start that few reach fails however good the forecaster is (at 0.9 and 0.9, with fewer than 22
    attempted units); one that is too permissive fails because the rate is too low. In between the
    exact chance of passing has a plateau; testing starts at its middle.
    """
    shares = (np.arange(steps) + 1) / steps
    thresholds = np.unique(np.quantile(probability, 1.0 - shares, method="lower"))[::-1]
    number = np.unique(units, return_inverse=True)[1]
    chance = []
    for threshold in thresholds.tolist():
        share, held = UnitShares.at(threshold, probability, success, number).evidence(weight)
        trials = int(calibration_units * share)
        chance.append(power(trials, held, rate=rate, confidence=confidence) if trials else 0.0)
    plateau = np.flatnonzero(np.array(chance) >= max(chance) - 0.01)
    start = int(plateau[len(plateau) // 2])
    weights = tuple(float(i == start) for i in range(len(thresholds)))
    return ThresholdSequence(
        tuple(thresholds.tolist()), weights, f"{len(probability)} out-of-fold trials"
    )


def explore(
    probability: Float[ndarray, "n"],
    success: Bool[ndarray, "n"],
    units: ndarray,
    *,
    spend: float,
    seed: int,
    rate: float,
    confidence: float,
    weight: str,
) -> tuple[ThresholdSequence, Bool[ndarray, "n"]]:
    """Spend some units on a sequence; the others remain for certifying.

    Parameters
    ----------
    probability, success, units, rate, confidence, weight
        As for :func:`learn_sequence`.
    spend
        The share of units to spend; 0 gives :func:`default_sequence`, and keeps all.
    seed
        Of which units.

    Returns
    -------
        The sequence, and which trials remain.

    Raises
    ------
    InputError
        If no unit is left on one of the sides.
    """
    names = np.unique(units)
    count = round(spend * len(names))
    if spend == 0.0:
        return default_sequence(rate), np.ones(len(units), bool)
    if not 0 < count < len(names):
        raise InputError(f"a share of {spend:g} of {len(names)} units leaves a side without any")
    spent = np.isin(units, np.random.default_rng([seed, 1]).permutation(names)[:count])
    sequence = learn_sequence(
        probability[spent],
        success[spent],
        units[spent],
        rate=rate,
        confidence=confidence,
        calibration_units=len(names) - count,
        weight=weight,
    )
    source = f"{count} of {len(names)} units, spent on it"
    return replace(sequence, source=source), ~spent
