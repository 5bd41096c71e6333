"""The order in which thresholds are tested: fixed sequence testing (Learn-then-Test).

The sequence, and where testing starts in it, must not depend on the data that is tested. There are
two: one that depends on no data (:func:`default_sequence`), and one that is learned from other data
(:func:`learn_sequence`), for example out-of-fold predictions of the training data.

References
----------
Angelopoulos, Bates, Candès, Jordan and Lei (2021). Learn then Test: Calibrating Predictive
Algorithms to Achieve Risk Control. arXiv 2110.01052.

Wiens (2003). A fixed sequence Bonferroni procedure for testing multiple endpoints. Pharmaceutical
Statistics 2(3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.guarantees.attempts import Forecasts, Outcomes, largest
from graspcast.guarantees.binomial import lower_bound, power
from graspcast.guarantees.unit_draws import UnitShares, Weight

__all__ = [
    "ThresholdSequence",
    "check_target",
    "default_sequence",
    "from_threshold_on",
    "learn_sequence",
    "split_sequence",
]


_HOPELESS = 0.01
"""With less power than this, the rate is out of reach."""


@dataclass(frozen=True)
class ThresholdSequence:
    """Thresholds from strict to permissive, and the share of the allowed error for each.

    The allowed error, 1 - confidence, is divided among the thresholds by ``weights``. A threshold
    is tested at its own part plus the level at which the one before it passed; one that fails
    passes nothing on. This is the fallback procedure of Wiens (2003): the probability of any false
    certification is at most 1 - confidence, however the tests depend on one another. With all
    weight on one threshold it is fixed sequence testing that starts there.

    Attributes
    ----------
    thresholds
        Descending probabilities.
    weights
        One for each threshold, not negative, summing to 1.
    source
        The data that it was fixed on, in words.

    Raises
    ------
    InputError
        If thresholds do not descend, or weights do not fit.
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
        """Return plain values, for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> ThresholdSequence:
        """Return the sequence that :meth:`as_dict` described.

        Raises
        ------
        KeyError, TypeError, ValueError, InputError
            If it describes none.
        """
        thresholds = tuple(float(t) for t in content["thresholds"])
        weights = tuple(float(w) for w in content["weights"])
        return cls(thresholds, weights, str(content["source"]))


def from_threshold_on(sequence: ThresholdSequence, lowest: float) -> ThresholdSequence:
    """Return a sequence without thresholds below one, which gets what was allowed to them.

    Parameters
    ----------
    sequence
        As it would be tested if outcomes were known at all thresholds.
    lowest
        The threshold below which nothing was attempted.
    """
    kept = [t for t in sequence.thresholds if t > lowest]
    if len(kept) == len(sequence.thresholds):
        return sequence
    rest = max(1.0 - sum(sequence.weights[: len(kept)]), 0.0)
    weights = (*sequence.weights[: len(kept)], rest)
    return replace(sequence, thresholds=(*kept, lowest), weights=weights)


def check_target(name: str, value: float) -> None:
    """Check that a rate or a confidence lies strictly between 0 and 1.

    Raises
    ------
    InputError
        If it does not.
    """
    if not 0.0 < value < 1.0:
        raise InputError(
            f"the {name} should be above 0 and below 1, not {value}", parameters=(name,)
        )


def default_sequence(rate: float) -> ThresholdSequence:
    """Return thresholds in steps of 0.01, where testing starts at and around the target rate.

    A calibrated forecaster reaches ``rate`` at the threshold ``rate``; half of the allowed error is
    spent there. A quarter is spent half-way from there to 1, for overconfident forecasters, and a
    quarter at 2 rate - 1 (0.8 for 0.9), for underconfident ones.
    """
    check_target("rate", rate)
    above, below = (1.0 + rate) / 2.0, max(2.0 * rate - 1.0, rate / 2.0)
    starts = {rate: 0.5, round(above, 9): 0.25, round(below, 9): 0.25}
    grid = {step / 100.0 for step in range(1, 100)}.union(starts)
    thresholds = tuple(sorted(grid, reverse=True))
    return ThresholdSequence(thresholds, tuple(starts.get(t, 0.0) for t in thresholds), "no data")


def learn_sequence(
    probability: Forecasts,
    success: Outcomes,
    units: ndarray,
    *,
    rate: float,
    confidence: float,
    calibration_units: int,
    weight: Weight = "attempt",
    steps: int = 50,
) -> ThresholdSequence:
    """Return a sequence that starts where, by other data, the test has the highest power.

    With a strict threshold few units have an attempt, and the test fails however good the
    forecaster is (at 0.9 and 0.9, with fewer than 22); with a permissive one the success rate is
    too low. In between, the exact power of the test has a plateau, and testing starts at its
    middle. Where the rate is out of reach of so few units, testing starts where the lower
    confidence bound of the success rate is expected to be highest.

    Parameters
    ----------
    probability, success
        Forecasts and outcomes (:mod:`graspcast.guarantees.attempts`) of data that are *not* the
        calibration data and that the forecaster was not trained on: out-of-fold predictions of its
        training data.
    units
        Their scenes or images, (n,).
    rate
        The success rate to be certified.
    confidence
        Of the guarantee.
    calibration_units
        How many units the calibration data will have.
    weight
        As for :func:`graspcast.certify`.
    steps
        How many thresholds there are: quantiles of the largest at which trials are attempted.
    """
    shares = (np.arange(steps) + 1) / steps
    thresholds = np.unique(np.quantile(largest(probability), 1.0 - shares, method="lower"))[::-1]
    number = np.unique(units, return_inverse=True)[1]
    powers, bounds = [], []
    for threshold in thresholds.tolist():
        share, success_rate = UnitShares.at(threshold, probability, success, number).expected_draws(
            weight
        )
        trials = int(calibration_units * share)
        powers.append(
            power(trials, success_rate, rate=rate, confidence=confidence) if trials else 0.0
        )
        held = int(trials * success_rate) if trials else 0
        bounds.append(lower_bound(held, trials, confidence))
    plateau = np.flatnonzero(np.array(powers) >= max(powers) - 0.01)
    start = int(plateau[len(plateau) // 2])
    if max(powers) < _HOPELESS:
        start = int(np.argmax(bounds))
    weights = tuple(float(i == start) for i in range(len(thresholds)))
    return ThresholdSequence(
        tuple(thresholds.tolist()), weights, f"{len(probability)} out-of-fold trials"
    )


def split_sequence(
    probability: Forecasts,
    success: Outcomes,
    units: ndarray,
    *,
    share: float,
    seed: int,
    rate: float,
    confidence: float,
    weight: Weight,
) -> tuple[ThresholdSequence, Bool[ndarray, " n"]]:
    """Learn the sequence from a random share of the units, and keep the others for certification.

    Angelopoulos et al. (2021) call it split fixed sequence testing.

    Parameters
    ----------
    probability, success, units, rate, confidence, weight
        As for :func:`learn_sequence`.
    share
        The share of units to learn from; 0 gives :func:`default_sequence`, and keeps all.
    seed
        Of the choice of units.

    Returns
    -------
        The sequence, and a mask of the trials that remain for certification.

    Raises
    ------
    InputError
        If one of the two parts has no unit.
    """
    names = np.unique(units)
    count = round(share * len(names))
    if share == 0.0:
        return default_sequence(rate), np.ones(len(units), bool)
    if not 0 < count < len(names):
        raise InputError(
            f"a share of {share:g} of {len(names)} units leaves one of the two parts empty",
            parameters=("sequence_share",),
        )
    chosen = np.isin(units, np.random.default_rng([seed, 1]).permutation(names)[:count])
    sequence = learn_sequence(
        probability[chosen],
        success[chosen],
        units[chosen],
        rate=rate,
        confidence=confidence,
        calibration_units=len(names) - count,
        weight=weight,
    )
    source = f"{count} of {len(names)} units, not used for certification"
    return replace(sequence, source=source), ~chosen
