"""Certifying: from calibration trials to a threshold at which a success rate can be promised.

Learn-then-Test (Angelopoulos, Bates, Candès, Jordan, Lei: arXiv 2110.01052, 2021): thresholds are
tested in a sequence that was fixed without the calibration data
(:mod:`graspcast.guarantees.threshold_sequence`), each by an exact binomial test.

**What is independent.** Trials in one scene are not: they share light, clutter and camera. Units
(scenes, or images) are what is drawn anew, so each unit bears *one* piece of evidence: one of its
trials, drawn by a seeded generator that does not look at outcomes. The drawn trials are independent
Bernoulli trials with the promised rate as their mean, whatever goes on inside a unit, so that the
binomial test is exact. The other trials of a unit are not lost: attempt rates use them.

**Over what.** ``weight="attempt"`` (the default) draws one of *all* trials of a unit, and keeps it
if it is attempted; units smaller than the largest are passed over by chance, in proportion, since
their instances are rarer. It promises P(success | attempted): every attempt counts alike, wherever
it is made. A drawn trial that is not attempted bears no evidence, so that
m units of which a share q is attempted bear that of m q trials. No other method can do much
better: were one unit in ten that is attempted *as a whole* a failure, so many would be needed to
see it. ``weight="unit"`` draws one of the *attempted* trials of each unit that has any. It promises
less, and of less data: that in a new unit in which anything is attempted, one of its attempts, each
alike, succeeds. A forecaster that attempts most in the scenes where it is most mistaken may keep
this promise, and fall short of the rate over all its attempts. The two are one where attempts are
equally frequent in all units, or units hold one trial each.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, get_args

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError, UnknownNameError
from graspcast.guarantees.binomial import lower_bound, mean_interval, needed_trials, p_value
from graspcast.guarantees.certificate import MOST_UNITS, OVERALL, Certificate, Guarantee, Weight
from graspcast.guarantees.threshold_sequence import (
    ThresholdSequence,
    UnitShares,
    check_target,
    default_sequence,
)
from graspcast.io.hashing import sha256

__all__ = ["certify"]


def certify(
    probability: Float[ndarray, "n"],
    success: Bool[ndarray, "n"],
    units: ndarray,
    *,
    rate: float,
    confidence: float,
    objects: ndarray | None = None,
    sequence: ThresholdSequence | None = None,
    weight: Weight = "attempt",
    simultaneous: bool = False,
    others: int = 0,
    seed: int = 0,
    provenance: Mapping[str, Any] | None = None,
) -> Certificate:
    """Find the thresholds at which a success rate can be promised.

    Over new units that come about as the calibration units did, and over the calibration units
    themselves, the chance that a threshold is returned whose attempts succeed at less than ``rate``
    is at most 1 - ``confidence``. The calibration data must not have taken part in training.

    Parameters
    ----------
    probability
        Forecasts for the calibration trials, (n,).
    success
        Their outcomes, (n,).
    units
        The scene or image of each, (n,); units are independent, trials within one need not be.
    rate
        The success rate to promise.
    confidence
        With which.
    objects
        Each trial's object; then there is a promise for each of them too.
    sequence
        Of the thresholds, fixed on other data; :func:`default_sequence` if None.
    weight
        Whether every attempt counts (``attempt``), or every unit that has any (``unit``); see this
        module's description.
    simultaneous
        All promises hold together with the confidence (Bonferroni: each gets its part of the
        allowed error). Otherwise each holds with it alone, and among many some may well be broken.
    others
        How many promises of other calls (other grippers, say) are to hold together with these.
    seed
        Of the draws; to be settled before the data are looked at. The order of the trials does not
        matter.
    provenance
        Kept with the result.

    Raises
    ------
    InputError
        If there are no trials, probabilities or shares are not between 0 and 1, or lengths differ.
    """
    _check(probability, success, units, objects, rate, confidence, weight)
    sequence = sequence or default_sequence(rate)
    scopes: list[tuple[str, ndarray]] = [(OVERALL, np.ones(len(units), bool))]
    if objects is not None:
        scopes += [(str(name), objects == name) for name in np.unique(objects)]
    family = len(scopes) + others if simultaneous else 1
    each = 1.0 - (1.0 - confidence) / family
    found = tuple(
        _certify_one(
            name, probability[mine], success[mine], units[mine], rate, each, sequence, weight, seed
        )
        for name, mine in scopes
    )
    return Certificate(
        found, rate, confidence, family, weight, seed, sequence, dict(provenance or {})
    )


def _check(
    probability: ndarray,
    success: ndarray,
    units: ndarray,
    objects: ndarray | None,
    rate: float,
    confidence: float,
    weight: str,
) -> None:
    check_target("rate", rate)
    check_target("confidence", confidence)
    if weight not in get_args(Weight):
        raise UnknownNameError("weight", weight, get_args(Weight))
    lengths = {len(a) for a in (probability, success, units, objects) if a is not None}
    if len(lengths) != 1:
        raise InputError(f"probabilities, outcomes, units and objects differ in length: {lengths}")
    if not len(probability):
        raise InputError(
            "there are no calibration trials: give outcomes that training has not seen"
        )
    if not ((probability >= 0) & (probability <= 1)).all():
        raise InputError("calibration probabilities should all be numbers between 0 and 1")


class _Draws:
    """One trial of each unit, drawn without a look at outcomes, the same in any order of trials."""

    def __init__(
        self, probability: ndarray, success: ndarray, units: ndarray, weight: Weight, seed: int
    ):
        # In an order that the data alone determine, keys are dealt out by a generator seeded with
        # the data too: with the same keys for all data, a seed that happens to favour units' most
        # probable trials would do so in every calibration.
        order = np.lexsort((success, probability, units))
        digest = sha256(units[order].astype(np.int64), probability[order].astype(np.float64))
        words = np.frombuffer(bytes.fromhex(digest), np.uint32)
        random = np.random.default_rng([seed, *words.tolist()])
        key = random.random(len(order))
        order = order[np.lexsort((key, units[order]))]
        self.probability, self.success, self.units = (
            probability[order],
            success[order],
            units[order],
        )
        if weight == "attempt":
            first = self._first(self.units)
            # A unit's one draw stands for all its trials, so that it is kept in proportion to them.
            size = np.diff(np.r_[first, len(self.units)])
            first = first[random.random(len(first)) < size / size.max(initial=1)]
            self.probability, self.success = self.probability[first], self.success[first]
            self.units = self.units[first]

    @staticmethod
    def _first(units: ndarray) -> ndarray:
        return np.flatnonzero(np.r_[True, units[1:] != units[:-1]]) if len(units) else units[:0]

    def at(self, threshold: float) -> tuple[int, int]:
        """How many units have a drawn attempt, and how many of these attempts succeeded."""
        attempt = np.flatnonzero(self.probability >= threshold)
        if not len(attempt):
            return 0, 0
        drawn = attempt[self._first(self.units[attempt])]
        return len(drawn), int(self.success[drawn].sum())


def _certify_one(
    scope: str,
    probability: ndarray,
    success: ndarray,
    units: ndarray,
    rate: float,
    confidence: float,
    sequence: ThresholdSequence,
    weight: Weight,
    seed: int,
) -> Guarantee:
    number = np.unique(units, return_inverse=True)[1]
    draws = _Draws(probability, success, number, weight, seed)
    allowed = 1.0 - confidence
    certified, spent, carried = None, allowed, 0.0
    for threshold, part in zip(sequence.thresholds, sequence.weights, strict=True):
        level = carried + part * allowed
        if level > 0.0:
            count, held = draws.at(threshold)
            passed = p_value(held, count, rate) <= level
            carried = level if passed else 0.0
            if passed:
                certified, spent = threshold, level
    needed = None
    shown = certified
    if shown is None:
        shown, needed = _fewest(probability, success, number, rate, confidence, sequence, weight)
    shares = UnitShares.at(shown, probability, success, number)
    attempt = probability >= shown
    count, held = draws.at(shown)
    return Guarantee(
        scope=scope,
        threshold=certified,
        rate=rate,
        confidence=confidence,
        units=len(shares.attempted),
        trials=len(units),
        shown_at=shown,
        attempted_units=count,
        successes=held,
        lower=lower_bound(held, count, 1.0 - spent),
        attempts=int(attempt.sum()),
        attempts_held=int((attempt & success).sum()),
        attempt_rate=float(shares.attempted.mean()),
        attempt_interval=mean_interval(shares.attempted, confidence),
        needed_units=needed,
    )


def _fewest(
    probability: ndarray,
    success: ndarray,
    number: ndarray,
    rate: float,
    confidence: float,
    sequence: ThresholdSequence,
    weight: Weight,
) -> tuple[float, int | None]:
    """The threshold that fewest fresh units would certify, and how many; else the first start."""
    fewest, at = MOST_UNITS + 1, None
    attempts = -1
    for threshold in sequence.thresholds:
        before, attempts = attempts, int((probability >= threshold).sum())
        if attempts == before:
            continue
        share, held = UnitShares.at(threshold, probability, success, number).evidence(weight)
        most = int((fewest - 1) * share)
        needed = needed_trials(held, rate=rate, confidence=confidence, most=most) if share else None
        if needed is not None:
            fewest, at = int(np.ceil(needed / share)), threshold
    if at is None:
        return sequence.thresholds[int(np.argmax(sequence.weights))], None
    return at, fewest
