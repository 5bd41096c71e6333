"""What calibration data promise beside what was asked of them.

If no threshold can be certified for the rate r that was asked for, a lower rate can still be
promised at the same confidence. At each threshold at which testing starts, with a share w of the
allowed error, the exact lower confidence bound L of the success rate at level w (1 - confidence) is
taken; all these bounds hold together, and the highest one is promised (:func:`best_promise`).

That first the rate r is tested, and only if it fails the bounds are used, costs no further error.
The fallback procedure tests the i-th threshold that does not reach r at a level e_i, and these sum
to at most 1 - confidence. If testing starts there, its bound has a level of w (1 - confidence) <=
e_i, and is below r or would have passed. So a false certificate at r, and a bound there that is
false, are both contained in the event that the p-value at the true rate is e_i or less. A bound of
a threshold that does reach r cannot be false, as it is below r. So the probability that what is
promised in the end is false is at most the sum of e_i.

Everything else says what *would* have been promised had it been asked for beforehand: choosing
among rates, confidences or alternatives by the data that are tested would not keep the confidence.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from graspcast.guarantees.binomial import lower_bound, p_value
from graspcast.guarantees.threshold_sequence import ThresholdSequence
from graspcast.guarantees.unit_draws import UnitDraws

__all__ = ["Alternative", "Promise", "best_promise", "highest_confidence", "limit_of_rate"]


@dataclass(frozen=True)
class Promise:
    """A rate that holds at a threshold, at the confidence of the guarantee it belongs to.

    Attributes
    ----------
    threshold
        Attempt at this probability or above it.
    rate
        The exact lower confidence bound of the success rate there.
    drawn_attempts, drawn_successes
        Number of drawn trials that are attempted there, and how many of these succeeded.
    """

    threshold: float
    rate: float
    drawn_attempts: int
    drawn_successes: int

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Promise:
        """Return the promise that ``asdict`` described.

        Raises
        ------
        KeyError, TypeError, ValueError
            If it describes none.
        """
        counts = [content["drawn_attempts"], content["drawn_successes"]]
        if any(type(n) is not int or n < 0 for n in counts):
            raise ValueError("the promise's drawn trials are not whole numbers, 0 or more")
        return cls(_share(content["threshold"]), _share(content["rate"]), *counts)


@dataclass(frozen=True)
class Alternative:
    """What would have been promised, had another kind of guarantee been asked for beforehand.

    Attributes
    ----------
    name
        What is otherwise, in words.
    unit
        What the units are.
    units
        How many there are.
    threshold
        That would have been certified for the rate and confidence asked for; None if none.
    best
        The highest rate at that confidence; None if none above 0.
    possible_confidence
        The highest confidence at that rate; 0 if none.
    needed_units
        How many new units would certify what was asked for, if the success rate seen continues;
        None if too many, or if it would have been certified.
    """

    name: str
    unit: str
    units: int
    threshold: float | None
    best: Promise | None
    possible_confidence: float
    needed_units: int | None

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Alternative:
        """Return the alternative that ``asdict`` described.

        Raises
        ------
        KeyError, TypeError, ValueError
            If it describes none.
        """
        threshold, best = content["threshold"], content["best"]
        needed = content["needed_units"]
        for count in (content["units"], 0 if needed is None else needed):
            if type(count) is not int or count < 0:
                raise ValueError("the alternative's units are not whole numbers, 0 or more")
        return cls(
            name=str(content["name"]),
            unit=str(content["unit"]),
            units=content["units"],
            threshold=None if threshold is None else _share(threshold),
            best=None if best is None else Promise.from_dict(best),
            possible_confidence=_share(content["possible_confidence"]),
            needed_units=needed,
        )


def best_promise(
    draws: UnitDraws, sequence: ThresholdSequence, confidence: float
) -> Promise | None:
    """Return the highest rate that is promised at a confidence; None if it is 0.

    Parameters
    ----------
    draws
        One trial of each unit.
    sequence
        Of thresholds, fixed beforehand; those with a weight, at which testing starts, are used.
    confidence
        Of the promise.
    """
    best: Promise | None = None
    for threshold, weight in zip(sequence.thresholds, sequence.weights, strict=True):
        if weight <= 0.0:
            continue
        attempts, successes = draws.count(threshold)
        rate = lower_bound(successes, attempts, 1.0 - weight * (1.0 - confidence))
        # Of equal rates, that of the lowest threshold: it attempts most.
        if rate > 0.0 and (best is None or rate >= best.rate):
            best = Promise(threshold, rate, attempts, successes)
    return best


def highest_confidence(draws: UnitDraws, sequence: ThresholdSequence, rate: float) -> float:
    """Return the highest confidence at which a rate would have been certified; 0 if none.

    Parameters
    ----------
    draws, sequence
        As for :func:`best_promise`.
    rate
        To be certified.
    """
    values = [
        p_value(successes, attempts, rate) / weight
        for threshold, weight in zip(sequence.thresholds, sequence.weights, strict=True)
        if weight > 0.0
        for attempts, successes in [draws.count(threshold)]
    ]
    return max(0.0, 1.0 - min(values))


def limit_of_rate(units: int, confidence: float) -> float:
    """Return the highest rate that so many drawn attempts can promise, if all succeed."""
    return float((1.0 - confidence) ** (1.0 / units))


def _share(value: Any) -> float:
    if isinstance(value, bool) or not 0.0 <= float(value) <= 1.0:
        raise ValueError(f"{value!r} is not between 0 and 1")
    return float(value)
