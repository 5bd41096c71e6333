"""The promise: a threshold above which grasps succeed at a wanted rate, with a stated confidence.

Learn-then-Test (Angelopoulos, Bates, Candès, Jordan, Lei: arXiv 2110.01052, 2021): thresholds are
tested in a sequence that was fixed without the calibration data (:mod:`graspcast.thresholds`), each
by an exact binomial test.

**What is independent.** Trials in one scene are not: they share light, clutter and camera. Units
(scenes, or images) are what is drawn anew, so each unit bears *one* piece of evidence: one of its
trials, drawn by a seeded generator that does not look at outcomes. The drawn trials are independent
Bernoulli trials with the promised rate as their mean, whatever goes on inside a unit, so that the
binomial test is exact. The other trials of a unit are not lost: attempt rates use them.

**Over what.** ``weight="attempt"`` (the default) draws one of *all* trials of a unit, and keeps it
if it is attempted. It promises P(success | attempted) for an instance drawn from a new unit: every
attempt counts, wherever it is made. A drawn trial that is not attempted bears no evidence, so that
m units of which a share q is attempted bear that of m q trials. No other method can do much
better: were one unit in ten that is attempted *as a whole* a failure, so many would be needed to
see it. ``weight="unit"`` draws one of the *attempted* trials of each unit that has any. It promises
less, and of less data: that in a new unit in which anything is attempted, one of its attempts, each
alike, succeeds. A forecaster that attempts most in the scenes where it is most mistaken may keep
this promise, and fall short of the rate over all its attempts. The two are one where attempts are
equally frequent in all units, or units hold one trial each.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from os import PathLike
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.binomial import lower_bound, mean_interval, needed_trials, p_value
from graspcast.bop.json_files import read_json, require
from graspcast.errors import FormatError, GraspcastError, InputError, UnknownNameError
from graspcast.files import write_text
from graspcast.thresholds import Sequence, UnitShares, default_sequence

__all__ = ["OVERALL", "Promise", "Promises", "Weight", "certify"]

OVERALL = "all objects"
Weight = Literal["attempt", "unit"]
_FORMAT = 1


@dataclass(frozen=True)
class Promise:
    """What can be promised of one scope, and on what evidence.

    Attributes:
        scope: :data:`OVERALL`, or an object (``dataset-number``).
        threshold: Attempt at this probability or above it; None if nothing can be certified.
        rate: Attempts succeed at least at this rate ...
        confidence: ... but for a chance of 1 - confidence that the calibration data misled.
        units, trials: In the calibration data.
        shown_at: The threshold that the figures below belong to: the certified one, or where none
            could be, the one that would need the fewest units.
        attempted_units, successes: Units with a drawn attempt, and how many of these succeeded.
        lower: The exact lower bound that these give at the level of error spent on this threshold.
        attempts, attempts_held: All attempted trials, and how many of these succeeded.
        attempt_rate: Expected share of a new unit's instances that are attempted.
        attempt_interval: Its two-sided interval, at ``confidence``.
        needed_units: Where nothing is certified: how many *fresh* units would certify
            ``shown_at``, if the success rate seen there went on; None if not even 100,000 would.
    """

    scope: str
    threshold: float | None
    rate: float
    confidence: float
    units: int
    trials: int
    shown_at: float
    attempted_units: int
    successes: int
    lower: float
    attempts: int
    attempts_held: int
    attempt_rate: float
    attempt_interval: tuple[float, float]
    needed_units: int | None = None

    @property
    def needed_trials(self) -> int | None:
        """:attr:`needed_units`, as trials, at the calibration data's trials per unit."""
        if self.needed_units is None:
            return None
        return int(np.ceil(self.needed_units * self.trials / self.units))

    def __str__(self) -> str:
        if self.threshold is not None:
            return (
                f"{self.scope}: at probability >= {self.threshold:.3g} attempts succeed at a rate "
                f"of at least {self.rate:g} (confidence {self.confidence:g}); "
                f"{self.attempt_rate:.0%} are attempted"
            )
        text = (
            f"{self.scope}: no threshold can be certified for a rate of {self.rate:g} with "
            f"confidence {self.confidence:g} from {self.units} units"
        )
        if self.needed_units is None:
            return f"{text}, nor from any number of them: the ranking nowhere shows such a rate"
        return (
            f"{text}; about {self.needed_units} fresh units ({self.needed_trials} trials) would do "
            f"at probability >= {self.shown_at:.3g}, if the rate seen there goes on"
        )


@dataclass(frozen=True)
class Promises:
    """The promises of one calibration, overall and by object.

    Attributes:
        promises: The overall one first.
        rate, confidence: As asked for.
        family: How many promises hold *together* with this confidence (each is then made with
            1 - (1 - confidence) / family); 1 if each holds alone.
        weight: As for :func:`certify`.
        seed: Of the draws.
        sequence: Of the thresholds.
        provenance: Whose data these were: model, gripper, kind of unit, versions.
    """

    promises: tuple[Promise, ...]
    rate: float
    confidence: float
    family: int
    weight: Weight
    seed: int
    sequence: Sequence
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def overall(self) -> Promise:
        """That of all objects together."""
        return self.promises[0]

    def of(self, scope: str) -> Promise:
        """That of an object.

        Raises:
            UnknownNameError: if there is none.
        """
        by_name = {p.scope: p for p in self.promises}
        if scope not in by_name:
            raise UnknownNameError("scope of a promise", scope, by_name)
        return by_name[scope]

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {"format": _FORMAT, **asdict(self)}

    def save(self, path: str | PathLike[str]) -> None:
        """Write it as JSON, whole or not at all."""
        text = json.dumps(self.as_dict(), indent=2, allow_nan=False)
        write_text(path, text + "\n")

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Promises:
        """Read what :meth:`save` wrote.

        Raises:
            FormatError: naming the entry that is missing or wrong.
        """
        content = read_json(path, dict)
        if (found := require(content, "format", path, "top level")) != _FORMAT:
            raise FormatError(path, f"is a promise of format {found}, not {_FORMAT}")
        names = [f.name for f in fields(cls)]
        given = {name: require(content, name, path, "top level") for name in names}
        try:
            entries = tuple(_promise(entry) for entry in given["promises"])
            if (
                not entries
                or entries[0].scope != OVERALL
                or given["weight"] not in get_args(Weight)
            ):
                raise ValueError("no overall promise first, or an unknown weight")
            return cls(
                promises=entries,
                rate=_within(given["rate"]),
                confidence=_within(given["confidence"]),
                family=int(given["family"]),
                weight=given["weight"],
                seed=int(given["seed"]),
                sequence=Sequence.from_dict(given["sequence"]),
                provenance=dict(given["provenance"]),
            )
        except (KeyError, TypeError, ValueError, GraspcastError) as error:
            raise FormatError(
                path, f"is not a whole promise file ({error}); certify again"
            ) from error


def _within(value: Any) -> float:
    if isinstance(value, bool) or not 0.0 <= float(value) <= 1.0:
        raise ValueError(f"{value!r} is not between 0 and 1")
    return float(value)


def _promise(entry: Mapping[str, Any]) -> Promise:
    shares = ("rate", "confidence", "shown_at", "lower", "attempt_rate")
    counts = ("units", "trials", "attempted_units", "successes", "attempts", "attempts_held")
    values: dict[str, Any] = {name: _within(entry[name]) for name in shares}
    for name in counts:
        if type(entry[name]) is not int or entry[name] < 0:
            raise ValueError(f"{name} is {entry[name]!r}, not a whole number")
        values[name] = entry[name]
    needed = entry["needed_units"]
    low, high = entry["attempt_interval"]
    return Promise(
        scope=str(entry["scope"]),
        threshold=None if entry["threshold"] is None else _within(entry["threshold"]),
        attempt_interval=(_within(low), _within(high)),
        needed_units=None if needed is None else int(needed),
        **values,
    )


def certify(
    probability: Float[ndarray, "n"],
    success: Bool[ndarray, "n"],
    units: ndarray,
    *,
    rate: float,
    confidence: float,
    objects: ndarray | None = None,
    sequence: Sequence | None = None,
    weight: Weight = "attempt",
    simultaneous: bool = False,
    others: int = 0,
    seed: int = 0,
    provenance: Mapping[str, Any] | None = None,
) -> Promises:
    """Find the thresholds at which a success rate can be promised.

    Over new units that come about as the calibration units did, and over the calibration units
    themselves, the chance that a threshold is returned whose attempts succeed at less than ``rate``
    is at most 1 - ``confidence``. The calibration data must not have taken part in training.

    Args:
        probability: Forecasts for the calibration trials, (n,).
        success: Their outcomes, (n,).
        units: The scene or image of each, (n,); units are independent, trials within one need not
            be.
        rate: The success rate to promise.
        confidence: With which.
        objects: Each trial's object; then there is a promise for each of them too.
        sequence: Of the thresholds, fixed on other data; :func:`default_sequence` if None.
        weight: Whether every attempt counts (``attempt``), or every unit that has any (``unit``);
            see this module's description.
        simultaneous: All promises hold together with the confidence (Bonferroni: each gets its
            part of the allowed error). Otherwise each holds with it alone, and among many some
            may well be broken.
        others: How many promises of other calls (other grippers, say) are to hold together with
            these.
        seed: Of the draws; to be settled before the data are looked at. The order of the trials
            does not matter.
        provenance: Kept with the result.

    Raises:
        InputError: if there are no trials, probabilities or shares are not between 0 and 1, or
            lengths differ.
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
    return Promises(found, rate, confidence, family, weight, seed, sequence, dict(provenance or {}))


def _check(
    probability: ndarray,
    success: ndarray,
    units: ndarray,
    objects: ndarray | None,
    rate: float,
    confidence: float,
    weight: str,
) -> None:
    for name, value in (("rate", rate), ("confidence", confidence)):
        if not 0.0 < value < 1.0:
            raise InputError(f"the {name} should be above 0 and below 1, not {value}")
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
        # Keys are dealt out in an order that the data alone determine.
        order = np.lexsort((success, probability, units))
        key = np.random.default_rng(seed).random(len(order))
        order = order[np.lexsort((key, units[order]))]
        self.probability, self.success, self.units = (
            probability[order],
            success[order],
            units[order],
        )
        if weight == "attempt":
            first = self._first(self.units)
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
    sequence: Sequence,
    weight: Weight,
    seed: int,
) -> Promise:
    draws = _Draws(probability, success, units, weight, seed)
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
        shown, needed = _fewest(probability, success, units, rate, confidence, sequence, weight)
    shares = UnitShares.at(shown, probability, success, units)
    attempt = probability >= shown
    count, held = draws.at(shown)
    return Promise(
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
    units: ndarray,
    rate: float,
    confidence: float,
    sequence: Sequence,
    weight: Weight,
) -> tuple[float, int | None]:
    """The threshold that fewest fresh units would certify, and how many; else the first start."""
    fewest, at = 100_000, None
    for threshold in sequence.thresholds:
        share, held = UnitShares.at(threshold, probability, success, units).evidence(weight)
        most = int((fewest - 1) * share)
        needed = needed_trials(held, rate=rate, confidence=confidence, most=most) if share else None
        if needed is not None:
            fewest, at = int(np.ceil(needed / share)), threshold
    if at is None:
        return sequence.thresholds[int(np.argmax(sequence.weights))], None
    return at, fewest
