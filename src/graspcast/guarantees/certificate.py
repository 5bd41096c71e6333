"""What is promised of attempted grasps, on what evidence; and its file.

How a promise comes about stands in :mod:`graspcast.guarantees.certify`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from os import PathLike
from typing import Any, Literal, get_args

from graspcast.errors import FormatError, GraspcastError, UnknownNameError
from graspcast.guarantees.threshold_sequence import ThresholdSequence
from graspcast.io.json import read_json, require, write_json

__all__ = [
    "MOST_UNITS",
    "OVERALL",
    "Certificate",
    "Guarantee",
    "Weight",
]

OVERALL = "all objects"
MOST_UNITS = 10_000
Weight = Literal["attempt", "unit"]
_FORMAT = 1


@dataclass(frozen=True)
class Guarantee:
    """What can be promised of one scope, and on what evidence.

    Attributes
    ----------
    scope
        :data:`OVERALL`, or an object (``dataset-number``).
    threshold
        Attempt at this probability or above it; None if nothing can be certified.
    rate
        Attempts succeed at least at this rate ...
    confidence
        ... but for a chance of 1 - confidence that the calibration data misled.
    units, trials
        In the calibration data.
    shown_at
        The threshold that the figures below belong to: the certified one, or where none could be,
        the one that would need the fewest units.
    attempted_units, successes
        Units with a drawn attempt, and how many of these succeeded.
    lower
        The exact lower bound that these give at the error spent on this threshold; where nothing is
        certified, at all of the allowed error, as if testing had started here.
    attempts, attempts_held
        All attempted trials, and how many of these succeeded.
    attempt_rate
        Expected share of a new unit's instances that are attempted.
    attempt_interval
        Its two-sided interval, at ``confidence``.
    needed_units
        Where nothing is certified: how many *fresh* units would certify ``shown_at``, if testing
        starts there and the success rate seen there goes on; None if not even 10,000 would.
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
        return -(-self.needed_units * self.trials // self.units)

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
            return (
                f"{text}, nor from {MOST_UNITS:,} of these: nowhere does it clearly reach that rate"
            )
        return (
            f"{text}; about {self.needed_units} fresh units ({self.needed_trials} trials) would do "
            f"if testing starts at {self.shown_at:.3g} and the rate seen there goes on"
        )


@dataclass(frozen=True)
class Certificate:
    """The promises of one calibration, overall and by object.

    Attributes
    ----------
    guarantees
        The overall one first.
    rate, confidence
        As asked for.
    family
        How many promises hold *together* with this confidence (each is then made with 1 - (1 -
        confidence) / family); 1 if each holds alone.
    weight
        As for :func:`graspcast.certify`.
    seed
        Of the draws.
    sequence
        Of the thresholds.
    provenance
        Whose data these were: model, gripper, kind of unit, versions.
    """

    guarantees: tuple[Guarantee, ...]
    rate: float
    confidence: float
    family: int
    weight: Weight
    seed: int
    sequence: ThresholdSequence
    provenance: Mapping[str, Any] = field(default_factory=dict)

    @property
    def overall(self) -> Guarantee:
        """That of all objects together."""
        return self.guarantees[0]

    def of(self, scope: str) -> Guarantee:
        """That of an object.

        Raises
        ------
        UnknownNameError
            If there is none.
        """
        by_name = {p.scope: p for p in self.guarantees}
        if scope not in by_name:
            raise UnknownNameError("scope of a promise", scope, by_name)
        return by_name[scope]

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {"format": _FORMAT, **asdict(self)}

    def save(self, path: str | PathLike[str]) -> None:
        """Write it as JSON, whole or not at all."""
        write_json(path, self.as_dict())

    @classmethod
    def load(cls, path: str | PathLike[str]) -> Certificate:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FormatError
            Naming the entry that is missing or wrong.
        """
        content = read_json(path, dict)
        if (found := require(content, "format", path, "top level")) != _FORMAT:
            raise FormatError(path, f"is a promise of format {found}, not {_FORMAT}")
        names = [f.name for f in fields(cls)]
        given = {name: require(content, name, path, "top level") for name in names}
        try:
            entries = tuple(_promise(entry) for entry in given["guarantees"])
            if not entries or entries[0].scope != OVERALL:
                raise ValueError("the overall promise is not the first")
            if given["weight"] not in get_args(Weight):
                raise ValueError(f"unknown weight {given['weight']!r}")
            return cls(
                guarantees=entries,
                rate=_within(given["rate"]),
                confidence=_within(given["confidence"]),
                family=int(given["family"]),
                weight=given["weight"],
                seed=int(given["seed"]),
                sequence=ThresholdSequence.from_dict(given["sequence"]),
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


def _promise(entry: Mapping[str, Any]) -> Guarantee:
    shares = ("rate", "confidence", "shown_at", "lower", "attempt_rate")
    counts = ("units", "trials", "attempted_units", "successes", "attempts", "attempts_held")
    values: dict[str, Any] = {name: _within(entry[name]) for name in shares}
    for name in counts:
        if type(entry[name]) is not int or entry[name] < 0:
            raise ValueError(f"{name} is {entry[name]!r}, not a whole number")
        values[name] = entry[name]
    needed = entry["needed_units"]
    low, high = entry["attempt_interval"]
    return Guarantee(
        scope=str(entry["scope"]),
        threshold=None if entry["threshold"] is None else _within(entry["threshold"]),
        attempt_interval=(_within(low), _within(high)),
        needed_units=None if needed is None else int(needed),
        **values,
    )
