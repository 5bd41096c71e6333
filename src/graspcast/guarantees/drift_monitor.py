"""A monitor of promises in the field: does the rate that was promised still hold?

A test by betting (Shafer 2021; Ramdas, Grünwald, Vovk and Shafer 2023). The monitor bets against
the promise: a stake that grows by every failure and shrinks by every success, so that while the
promise holds no bet is in its favour. By Ville's (1939) inequality the stake then ever exceeds
1 / alpha with a chance of at most alpha, however long it runs and whenever one looks.

**What is assumed while the promise holds.** Given all that has been seen before, the next trial
succeeds with at least the promised rate. Nothing else: trials may depend on one another, and the
rate may vary above the promised one. Repeats in one scene break this (after three failures in a
dark scene the fourth is likely too, though scenes keep the promise on the whole); so with units
given, the *unit's share* of successes is one observation, and what is assumed is that the next
unit's expected share, given all units before, is at least the rate. Each unit then counts the same
(``weight="unit"`` of :func:`graspcast.certify`). Where every attempt is to count
(``weight="attempt"``), units count by their attempts, which need a bound: ``most_attempts``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from os import PathLike
from typing import Any

from graspcast.errors import FormatError, InputError
from graspcast.io.json import read_json, require, write_json

__all__ = ["DriftMonitor"]

_FORMAT = 1
_LEVELS = 8


@dataclass
class DriftMonitor:
    """Watches a stream of attempted trials for a success rate below the promised one.

    ::

        monitor = DriftMonitor(rate=0.9, alpha=0.05)
        for success, scene in field:
            if monitor.observe(success, unit=scene): ...  # the promise no longer holds

    The stake is spread over eight alternatives (success rates below the promised one) and over
    when the drift began: a part 1 / (t (t + 1)) of it is first put in at observation t, so that a
    long good time is no debt to be worked off before an alarm. All of these are bets at even odds
    or worse while the promise holds, and so is their sum.

    Attributes
    ----------
    rate
        The promised success rate.
    alpha
        The chance of a false alarm, ever, until the monitor is restarted.
    most_attempts
        If given, no unit has more attempts, and a unit counts by its share of them.
    trials, successes
        Seen since the last restart.
    observations
        Closed units, or trials without a unit.
    alarm_at
        The trial (from 1) after which the alarm was raised; None without alarm. An alarm stays
        until :meth:`restart`.
    restarts
        How often it was restarted. Over k + 1 runs the chance of any false alarm is at most (k + 1)
        alpha.
    unit, unit_trials, unit_successes
        The unit that is not closed yet.
    log_stakes
        Logarithm of the stake on each alternative; -inf before the first observation.
    log_peak
        The largest logarithm of the whole stake so far.
    """

    rate: float
    alpha: float = 0.05
    most_attempts: int | None = None
    trials: int = 0
    successes: int = 0
    observations: int = 0
    alarm_at: int | None = None
    restarts: int = 0
    unit: str | None = None
    unit_trials: int = 0
    unit_successes: int = 0
    log_stakes: tuple[float, ...] = (-math.inf,) * _LEVELS
    log_peak: float = 0.0

    def __post_init__(self) -> None:
        for name in ("rate", "alpha"):
            if not 0.0 < getattr(self, name) < 1.0:
                raise InputError(
                    f"a monitor's {name} should be above 0 and below 1, not {getattr(self, name)}"
                )
        if self.most_attempts is not None and self.most_attempts < 1:
            raise InputError(f"most_attempts should be 1 or more, not {self.most_attempts}")

    @property
    def alarm(self) -> bool:
        """Whether the promise is taken to be broken."""
        return self.alarm_at is not None

    @property
    def log_evidence(self) -> float:
        """Logarithm of the stake; an alarm is raised when it reaches log(1 / alpha)."""
        spared = 1.0 / (self.observations + 1)
        return _log_sum((math.log(spared), *(s - math.log(_LEVELS) for s in self.log_stakes)))

    @property
    def evidence(self) -> float:
        """The stake, which began as 1 and raises an alarm at 1 / alpha."""
        return math.exp(min(self.log_evidence, 700.0))

    @property
    def evidence_peak(self) -> float:
        """The largest stake so far."""
        return math.exp(min(self.log_peak, 700.0))

    @property
    def alternatives(self) -> tuple[float, ...]:
        """The success rates that are bet on: from 19/20 to 1/3 of the promised one."""
        nearest, farthest = 0.95, 1.0 / 3.0
        ratio = (farthest / nearest) ** (1.0 / (_LEVELS - 1))
        return tuple(self.rate * nearest * ratio**i for i in range(_LEVELS))

    def observe(self, success: bool, unit: str | None = None) -> bool:
        """Take in one attempted trial; whether there is an alarm.

        Parameters
        ----------
        success
            Whether the grasp held.
        unit
            Its scene or image. A unit is weighed when the next one begins, or at :meth:`close`, so
            its trials should come together. None: the trial is its own unit.

        Raises
        ------
        InputError
            If a unit has more attempts than ``most_attempts``.
        """
        if self.unit is not None and unit != self.unit:
            self.close()
        if unit is not None and self.unit_trials == self.most_attempts:
            raise InputError(f"unit {unit} has more than {self.most_attempts} attempts")
        self.trials += 1
        self.successes += bool(success)
        if unit is None:
            self._weigh(float(bool(success)), 1)
            return self.alarm
        self.unit = unit
        self.unit_trials += 1
        self.unit_successes += bool(success)
        return self.alarm

    def close(self) -> bool:
        """Weigh the unit that is open, if one is; whether there is an alarm."""
        if self.unit is not None:
            self._weigh(self.unit_successes / self.unit_trials, self.unit_trials)
            self.unit, self.unit_trials, self.unit_successes = None, 0, 0
        return self.alarm

    def restart(self) -> None:
        """Forget evidence and alarm: after a new certification, or when the cause was removed."""
        self.trials = self.successes = self.observations = 0
        self.unit, self.unit_trials, self.unit_successes = None, 0, 0
        self.alarm_at, self.log_peak = None, 0.0
        self.log_stakes = (-math.inf,) * _LEVELS
        self.restarts += 1

    def _weigh(self, share: float, attempts: int) -> None:
        counted = 1.0 if self.most_attempts is None else attempts / self.most_attempts
        self.observations += 1
        begins = -math.log(self.observations * (self.observations + 1))
        stakes = []
        for stake, other in zip(self.log_stakes, self.alternatives, strict=True):
            # The likelihood ratio of a success or a failure, averaged over the unit's trials.
            ratio = share * other / self.rate + (1.0 - share) * (1.0 - other) / (1.0 - self.rate)
            stakes.append(_log_sum((stake, begins)) + math.log1p(counted * (ratio - 1.0)))
        self.log_stakes = tuple(stakes)
        evidence = self.log_evidence
        self.log_peak = max(self.log_peak, evidence)
        if self.alarm_at is None and evidence >= -math.log(self.alpha):
            self.alarm_at = self.trials

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON; a stake of nothing is null."""
        stakes = [None if s == -math.inf else s for s in self.log_stakes]
        return {"format": _FORMAT, **asdict(self), "log_stakes": stakes}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], path: str | PathLike[str]) -> DriftMonitor:
        """What :meth:`as_dict` gave; ``path`` is named in errors.

        Raises
        ------
        FormatError
            Naming the entry that is missing or wrong.
        """
        if (found := require(content, "format", path, "top level")) != _FORMAT:
            raise FormatError(path, f"is a monitor's state of format {found}, not {_FORMAT}")
        given = {f.name: require(content, f.name, path, "top level") for f in fields(cls)}
        try:
            given["log_stakes"] = tuple(
                -math.inf if s is None else float(s) for s in given["log_stakes"]
            )
            counts = ("trials", "successes", "observations", "restarts", "unit_trials")
            if any(type(given[name]) is not int or given[name] < 0 for name in counts):
                raise ValueError(f"{', '.join(counts)} should be whole numbers")
            if len(given["log_stakes"]) != _LEVELS or any(map(math.isnan, given["log_stakes"])):
                raise ValueError(f"there should be {_LEVELS} stakes")
            return cls(**given)
        except (TypeError, ValueError, InputError) as error:
            raise FormatError(path, f"is not a whole monitor's state ({error})") from error

    def save(self, path: str | PathLike[str]) -> None:
        """Write its state as JSON, whole or not at all."""
        write_json(path, self.as_dict())

    @classmethod
    def load(cls, path: str | PathLike[str]) -> DriftMonitor:
        """Go on from what :meth:`save` wrote.

        Raises
        ------
        FormatError
            Naming the entry that is missing or wrong.
        """
        return cls.from_dict(read_json(path, dict), path)


def _log_sum(logs: tuple[float, ...]) -> float:
    top = max(logs)
    return top if top == -math.inf else top + math.log(sum(math.exp(x - top) for x in logs))
