"""Guarantees of a success rate, and the certificate file that holds them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from os import PathLike
from typing import Any, get_args

from graspcast.errors import FormatError, GraspcastError, MismatchError, UnknownNameError
from graspcast.guarantees.look_policy import LookPolicy, check_policy
from graspcast.guarantees.promises import Alternative, Promise, limit_of_rate
from graspcast.guarantees.threshold_sequence import ThresholdSequence
from graspcast.guarantees.unit_draws import Weight
from graspcast.io.arguments import PATH, checked
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.io.json import require
from graspcast.io.wording import counted

__all__ = ["MAX_UNITS", "OVERALL", "Certificate", "Guarantee"]

OVERALL = "all objects"
"""The scope of the guarantee for all objects together."""
MAX_UNITS = 10_000
"""How many units :attr:`Guarantee.needed_units` is searched among."""
_FORMAT = 4
_READ = (2, 3, _FORMAT)
_FORMER: Mapping[str, Any] = {"policy": None, "alternatives": ()}
"""Format 2 has no policy: it is of the principal's one view. Before 4 nothing says what else the
data promise."""


@dataclass(frozen=True)
class Guarantee:
    """A guaranteed success rate of attempts in one scope, and the data it is based on.

    Attributes
    ----------
    scope
        :data:`OVERALL`, or an object (``dataset-obj_id``).
    threshold
        Attempt at this probability or above it; None if no threshold can be certified.
    rate
        Attempts succeed at this rate or above it: the rate that was asked for, or a lower one that
        was accepted.
    confidence
        1 - the probability of certifying a threshold that does not reach the rate.
    units, trials
        Numbers of those in the calibration data.
    reported_threshold
        The threshold at which the numbers below are computed: the certified one or, without one,
        the one that would need the fewest units.
    drawn_attempts, drawn_successes
        Number of drawn trials that are attempted (at most one of each unit), and how many of these
        succeeded.
    lower_bound
        Exact lower confidence bound of the success rate from the drawn attempts, at the error level
        of this threshold; without a certified one, at all of the allowed error, as if testing had
        started here.
    attempts, successful_attempts
        Number of all trials that are attempted, and how many of these succeeded.
    attempt_rate
        Mean over units of the share of trials that are attempted.
    attempt_rate_interval
        Its two-sided interval, at ``confidence``.
    needed_units
        Without a certified threshold: how many *new* units would certify ``reported_threshold`` if
        testing starts there and the success rate seen there continues; None if more than
        :data:`MAX_UNITS`.
    asked_rate
        The rate that was asked for; ``rate`` if None.
    best
        The highest rate at ``confidence``. Without a certified threshold it is promised, and holds
        if it is accepted (:mod:`graspcast.guarantees.promises`). With one it says what would have
        been promised, had it been asked for beforehand. None if it is 0, or unknown.
    possible_confidence
        The highest confidence at which the rate asked for would have been certified, had that been
        asked for beforehand; None if unknown.
    """

    scope: str
    threshold: float | None
    rate: float
    confidence: float
    units: int
    trials: int
    reported_threshold: float
    drawn_attempts: int
    drawn_successes: int
    lower_bound: float
    attempts: int
    successful_attempts: int
    attempt_rate: float
    attempt_rate_interval: tuple[float, float]
    needed_units: int | None = None
    asked_rate: float | None = None
    best: Promise | None = None
    possible_confidence: float | None = None

    @property
    def is_lower(self) -> bool:
        """Whether a lower rate than the one asked for was accepted."""
        return self.asked_rate is not None and self.rate < self.asked_rate

    @property
    def lower(self) -> Promise | None:
        """The lower rate that is promised if it is accepted, where the one asked for is not."""
        return self.best if self.threshold is None else None

    @property
    def limit(self) -> float:
        """The highest rate that so many units could promise, if every drawn attempt succeeded."""
        return limit_of_rate(self.units, self.confidence)

    @property
    def needed_trials(self) -> int | None:
        """:attr:`needed_units`, as trials, at the calibration data's trials per unit."""
        if self.needed_units is None:
            return None
        return -(-self.needed_units * self.trials // self.units)

    def __str__(self) -> str:
        if self.threshold is not None:
            return (
                f"{self.scope}: at probability >= {self.threshold:.3g} attempts succeed at a rate "
                f"of at least {_rounded_down(self.rate)} (confidence {self.confidence:g}); "
                f"{self.attempt_rate:.0%} are attempted"
                + (f"; the rate asked for was {self.asked_rate:g}" if self.is_lower else "")
            )
        text = (
            f"{self.scope}: no threshold can be certified for a rate of {self.rate:g} with "
            f"confidence {self.confidence:g} from {counted(self.units, 'unit')}"
        )
        if self.needed_units is None:
            text += (
                f", nor from {MAX_UNITS:,} of these: at no threshold is the success rate clearly "
                "above it"
            )
        else:
            text += (
                f"; about {self.needed_units} new units ({self.needed_trials} trials) would "
                f"suffice if testing starts at {self.reported_threshold:.3g} and the success rate "
                "seen there continues"
            )
        if self.lower is None:
            return text
        return (
            f"{text}. A rate of at least {_rounded_down(self.lower.rate)} at probability >= "
            f"{self.lower.threshold:.3g} can be, if that is accepted"
        )


@checked(path=PATH)
@dataclass(frozen=True)
class Certificate:
    """The guarantees from one set of calibration data, overall and by object.

    Attributes
    ----------
    guarantees
        The overall one first.
    rate, confidence
        The requested success rate and confidence.
    family_size
        How many guarantees hold *together* with the confidence (each is then made with confidence
        1 - (1 - confidence) / family_size); 1 if each holds individually.
    weight
        As for :func:`graspcast.certify`.
    seed
        Of the draws.
    sequence
        Of the thresholds.
    provenance
        The model's digest, ``ood_alpha``, principal, gripper, kind of unit, and versions; with a
        policy also ``guides``, the names of estimators and fused poses that guide attempts.
    policy
        What is certified, where it is more than the principal's one view.
    alternatives
        What would have been promised for all objects, had another kind of guarantee been asked for
        beforehand. None of these is promised.
    """

    guarantees: tuple[Guarantee, ...]
    rate: float
    confidence: float
    family_size: int
    weight: Weight
    seed: int
    sequence: ThresholdSequence
    provenance: Mapping[str, Any] = field(default_factory=dict)
    policy: LookPolicy | None = None
    alternatives: tuple[Alternative, ...] = ()

    def __repr__(self) -> str:
        return f"Certificate({self.overall})"

    @property
    def overall(self) -> Guarantee:
        """The guarantee for all objects together."""
        return self.guarantees[0]

    def of(self, scope: str) -> Guarantee:
        """Return the guarantee for an object (or :data:`OVERALL`).

        Raises
        ------
        UnknownNameError
            If there is none.
        """
        by_name = {g.scope: g for g in self.guarantees}
        if scope not in by_name:
            raise UnknownNameError("scope of a guarantee", scope, by_name, parameters=("object",))
        return by_name[scope]

    def check_belongs_to(
        self, model_digest: str, ood_alpha: float, policy: LookPolicy | None = None
    ) -> None:
        """Check that it was made for a model's forecasts, and for how they are used.

        Parameters
        ----------
        model_digest
            :attr:`graspcast.forecasting.model_card.ModelCard.digest`.
        ood_alpha
            Verdicts abstain at this p-value or below it. A certificate that does not state one fits
            any.
        policy
            Who guides, which views serve and how many looks; None is the principal's one view.

        Raises
        ------
        MismatchError
            If it was made for another.
        """
        if self.provenance.get("model") != model_digest:
            raise MismatchError(
                "the certificate was made for another model", parameters=("certificate", "model")
            )
        certified = self.provenance.get("ood_alpha", ood_alpha)
        if certified != ood_alpha:
            raise MismatchError(
                f"the certificate was made with ood_alpha {certified:g}, not {ood_alpha:g}: what "
                "is attempted would not be what was certified",
                parameters=("ood_alpha",),
            )
        check_policy(self.policy, policy)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return {"format": _FORMAT, **asdict(self)}

    def save(self, path: str | PathLike[str]) -> None:
        """Write it as JSON, atomically."""
        write_artefact(path, self.as_dict())

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Certificate:
        """Read a file that :meth:`save` wrote.

        Raises
        ------
        FormatError
            Naming the entry that is missing or wrong.
        """
        content = read_artefact(path, "certify again", parameters=("certificate",))
        if (found := require(content, "format", path, "top level")) not in _READ:
            raise FormatError(
                path,
                f"is a certificate of format {found}, not {_FORMAT}; certify again",
                parameters=("certificate",),
            )
        if found != _FORMAT:
            content = {**_FORMER, **content}
        given = {f.name: require(content, f.name, path, "top level") for f in fields(cls)}
        try:
            former: Mapping[str, Any] = {} if found == _FORMAT else _FORMER_GUARANTEE
            guarantees = tuple(_guarantee({**former, **g}) for g in given["guarantees"])
            if not guarantees or guarantees[0].scope != OVERALL:
                raise ValueError("the overall guarantee is not the first")
            if given["weight"] not in get_args(Weight):
                raise ValueError(f"unknown weight {given['weight']!r}")
            return cls(
                guarantees=guarantees,
                rate=_share(given["rate"]),
                confidence=_share(given["confidence"]),
                family_size=int(given["family_size"]),
                weight=given["weight"],
                seed=int(given["seed"]),
                sequence=ThresholdSequence.from_dict(given["sequence"]),
                provenance=dict(given["provenance"]),
                alternatives=tuple(map(Alternative.from_dict, given["alternatives"])),
                policy=None
                if (policy := given["policy"]) is None
                else LookPolicy.from_dict(policy),
            )
        except (KeyError, TypeError, ValueError, OverflowError, GraspcastError) as error:
            raise FormatError(
                path, f"is not a complete certificate ({error}); certify again"
            ) from error


def _share(value: Any) -> float:
    if isinstance(value, bool) or not 0.0 <= float(value) <= 1.0:
        raise ValueError(f"{value!r} is not between 0 and 1")
    return float(value)


def _count(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"{value!r} is not a whole number, 0 or more")
    return value


def _interval(value: Any) -> tuple[float, float]:
    low, high = map(_share, value)
    return low, high


def _rounded_down(rate: float) -> str:
    """Write a rate with three digits, none above it."""
    return f"{math.floor(rate * 1000 + 1e-9) / 1000:g}"


_FORMER_GUARANTEE: Mapping[str, Any] = {
    "asked_rate": None,
    "best": None,
    "possible_confidence": None,
}
_PARSERS: dict[str, Any] = {
    "str": str,
    "int": _count,
    "int | None": lambda value: None if value is None else _count(value),
    "float": _share,
    "float | None": lambda value: None if value is None else _share(value),
    "Promise | None": lambda value: None if value is None else Promise.from_dict(value),
    "tuple[float, float]": _interval,
}


def _guarantee(entry: Mapping[str, Any]) -> Guarantee:
    """Return the guarantee that ``asdict`` described, each field checked by its type."""
    return Guarantee(**{f.name: _PARSERS[str(f.type)](entry[f.name]) for f in fields(Guarantee)})
