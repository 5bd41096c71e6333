"""Certification: from calibration trials to a threshold with a guaranteed success rate.

Learn-then-Test (Angelopoulos et al. 2021): thresholds are tested in a sequence that was fixed
without the calibration data (:mod:`graspcast.guarantees.threshold_sequence`), each by an exact
binomial test (Clopper and Pearson 1934) on one trial of each unit
(:mod:`graspcast.guarantees.unit_draws`).

References
----------
Angelopoulos, Bates, Candès, Jordan and Lei (2021). Learn then Test: Calibrating Predictive
Algorithms to Achieve Risk Control. arXiv 2110.01052.

Clopper and Pearson (1934). The use of confidence or fiducial limits illustrated in the case of the
binomial. Biometrika 26(4).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from graspcast.errors import InputError, UnknownNameError
from graspcast.guarantees.attempts import Forecasts, Outcomes, attempts_at
from graspcast.guarantees.binomial import lower_bound, mean_interval, needed_trials, p_value
from graspcast.guarantees.certificate import MAX_UNITS, OVERALL, Certificate, Guarantee
from graspcast.guarantees.promises import best_promise, highest_confidence
from graspcast.guarantees.threshold_sequence import (
    ThresholdSequence,
    check_target,
    default_sequence,
)
from graspcast.guarantees.unit_draws import UnitDraws, UnitShares, Weight

__all__ = ["certify"]


def certify(
    probability: Forecasts,
    success: Outcomes,
    units: ndarray,
    *,
    rate: float,
    confidence: float,
    objects: ndarray | None = None,
    sequence: ThresholdSequence | None = None,
    weight: Weight = "attempt",
    simultaneous: bool = False,
    other_guarantees: int = 0,
    accept_lower: bool = False,
    seed: int = 0,
    provenance: Mapping[str, Any] | None = None,
) -> Certificate:
    """Find thresholds at which attempts are guaranteed to succeed at a given rate.

    With new units from the distribution of the calibration units, the probability (over the
    calibration units and the draws) that a threshold is returned at which attempts succeed at less
    than ``rate`` is at most 1 - ``confidence``. The calibration data must not have been used in
    training.

    Parameters
    ----------
    probability
        Forecasts for the calibration trials, (n,). Of a policy with several looks, all forecasts of
        each in order, (n, looks): it attempts at the first that reaches the threshold. NaN, where
        nothing is attempted at any threshold, is allowed in the latter alone.
    success
        Their outcomes, in the same shape; those at NaN do not count.
    units
        The scene or image of each, (n,); units are independent, trials within one need not be.
    rate
        The success rate to guarantee.
    confidence
        Of the guarantee.
    objects
        Each trial's object, for a guarantee for each of them too.
    sequence
        Of the thresholds, fixed on other data; :func:`default_sequence` if None.
    weight
        Whether all attempts are weighted equally (``attempt``), or all units that have any
        (``unit``); see :mod:`graspcast.guarantees.unit_draws`.
    simultaneous
        Make all guarantees hold together with the confidence (Bonferroni correction). Otherwise
        each holds with it individually.
    other_guarantees
        Number of guarantees of other calls (for example, of other grippers) that are to hold
        together with these.
    accept_lower
        Where no threshold can be certified for ``rate``, certify the highest lower rate that is
        promised at the confidence. The probability that what is certified is false is then at most
        1 - ``confidence`` too (:mod:`graspcast.guarantees.promises`).
    seed
        Of the draws; choose it before looking at the data. The order of the trials does not matter.
    provenance
        Stored in the certificate.

    Raises
    ------
    InputError
        If there are no trials, probabilities, ``rate`` or ``confidence`` are out of range, or
        lengths differ.
    """
    _check(probability, success, units, objects, weight)
    check_target("rate", rate)
    check_target("confidence", confidence)
    sequence = sequence or default_sequence(rate)
    scopes: list[tuple[str, ndarray]] = [(OVERALL, np.ones(len(units), bool))]
    if objects is not None:
        scopes += [(str(name), objects == name) for name in np.unique(objects)]
    family_size = len(scopes) + other_guarantees if simultaneous else 1
    each = 1.0 - (1.0 - confidence) / family_size
    test = _Test(rate, each, sequence, weight, seed, accept_lower)
    guarantees = tuple(
        test.certify(scope, probability[mine], success[mine], units[mine]) for scope, mine in scopes
    )
    return Certificate(
        guarantees, rate, confidence, family_size, weight, seed, sequence, dict(provenance or {})
    )


def _check(
    probability: ndarray, success: ndarray, units: ndarray, objects: ndarray | None, weight: str
) -> None:
    if weight not in get_args(Weight):
        raise UnknownNameError("weight", weight, get_args(Weight), parameters=("weight",))
    lengths = {len(a) for a in (probability, success, units, objects) if a is not None}
    if len(lengths) != 1:
        raise InputError(f"probabilities, outcomes, units and objects differ in length: {lengths}")
    if not len(probability):
        raise InputError(
            "there are no calibration trials: give outcomes that were not used in training",
            parameters=("outcomes",),
        )
    if probability.shape != success.shape:
        raise InputError(
            f"probabilities, {probability.shape}, and outcomes, {success.shape}, should have the "
            "same shape"
        )
    absent = np.isnan(probability) & (probability.ndim > 1)
    if not (absent | ((probability >= 0) & (probability <= 1))).all():
        raise InputError("calibration probabilities should all be numbers between 0 and 1")


@dataclass(frozen=True)
class _Test:
    """The settings of the test of one scope; ``confidence`` is that of a single guarantee."""

    rate: float
    confidence: float
    sequence: ThresholdSequence
    weight: Weight
    seed: int
    accept_lower: bool

    def certify(
        self,
        scope: str,
        probability: Forecasts,
        success: Outcomes,
        units: ndarray,
    ) -> Guarantee:
        """Return the guarantee for the trials of one scope."""
        number = np.unique(units, return_inverse=True)[1]
        draws = UnitDraws(probability, success, number, self.weight, self.seed)
        certified, error = self._last_passed(draws)
        best = best_promise(draws, self.sequence, self.confidence)
        rate, needed_units = self.rate, None
        threshold = certified
        if threshold is None:
            threshold, needed_units = self._fewest_units(probability, success, number)
            if best is not None and self.accept_lower:
                certified = threshold = best.threshold
                rate = best.rate
        shares = UnitShares.at(threshold, probability, success, number)
        attempted, successful = attempts_at(threshold, probability, success)
        drawn_attempts, drawn_successes = draws.count(threshold)
        return Guarantee(
            scope=scope,
            threshold=certified,
            rate=rate,
            confidence=self.confidence,
            units=len(shares.attempted),
            trials=len(units),
            reported_threshold=threshold,
            drawn_attempts=drawn_attempts,
            drawn_successes=drawn_successes,
            lower_bound=rate
            if rate < self.rate
            else lower_bound(drawn_successes, drawn_attempts, 1.0 - error),
            attempts=int(attempted.sum()),
            successful_attempts=int(successful.sum()),
            attempt_rate=float(shares.attempted.mean()),
            attempt_rate_interval=mean_interval(shares.attempted, self.confidence),
            needed_units=needed_units,
            asked_rate=self.rate,
            best=best,
            possible_confidence=highest_confidence(draws, self.sequence, self.rate),
        )

    def _last_passed(self, draws: UnitDraws) -> tuple[float | None, float]:
        """Return the last threshold that passes, and its error level; None and the whole error."""
        allowed = 1.0 - self.confidence
        certified, error, carried = None, allowed, 0.0
        for threshold, part in zip(self.sequence.thresholds, self.sequence.weights, strict=True):
            level = carried + part * allowed
            if level > 0.0:
                attempts, successes = draws.count(threshold)
                passed = p_value(successes, attempts, self.rate) <= level
                carried = level if passed else 0.0
                if passed:
                    certified, error = threshold, level
        return certified, error

    def _fewest_units(
        self, probability: Forecasts, success: Outcomes, number: Int[ndarray, " n"]
    ) -> tuple[float, int | None]:
        """Return the threshold that the fewest new units would certify, and how many.

        If :data:`MAX_UNITS` would not do at any, the threshold with the largest weight, and None.
        """
        fewest, best = MAX_UNITS + 1, None
        reached = -1
        for threshold in self.sequence.thresholds:
            before, reached = reached, int((probability >= threshold).sum())
            if reached == before:
                continue
            shares = UnitShares.at(threshold, probability, success, number)
            share, success_rate = shares.expected_draws(self.weight)
            if not share:
                continue
            needed = needed_trials(
                success_rate,
                rate=self.rate,
                confidence=self.confidence,
                max_trials=int((fewest - 1) * share),
            )
            if needed is not None:
                fewest, best = int(np.ceil(needed / share)), threshold
        if best is None:
            return self.sequence.thresholds[int(np.argmax(self.sequence.weights))], None
        return best, fewest
