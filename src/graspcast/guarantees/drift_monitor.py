"""Sequential monitoring of a guaranteed success rate, by betting (e-values).

The monitor is a test martingale for the hypothesis that attempts succeed at least at the guaranteed
rate. It starts with wealth 1 and bets against the hypothesis: failures increase the wealth,
successes decrease it, and while the hypothesis holds the wealth does not grow in expectation. By
Ville's inequality (1939) the wealth, the *e-value*, then ever exceeds 1 / alpha with probability
at most alpha, however long it runs and whenever one looks.

**Assumption under the hypothesis.** Given all earlier trials, the next one succeeds with
probability at least the rate. Trials may depend on one another, and the probability may vary above
the rate. Repeated trials in one scene violate this: after three failures in a dark scene the fourth
is likely too, though the rate is reached over scenes. So with units given, one observation is the
*share* of successes of a unit, and the assumption is that the expected share of the next unit,
given all units before, is at least the rate. All units are then weighted equally (``weight="unit"``
of :func:`graspcast.certify`). To weight all attempts equally (``weight="attempt"``), units are
weighted by their number of attempts, which needs an upper bound: ``max_attempts_per_unit``.

References
----------
Shafer (2021). Testing by betting: a strategy for statistical and scientific communication. Journal
of the Royal Statistical Society A 184(2).

Ramdas, Grünwald, Vovk and Shafer (2023). Game-theoretic statistics and safe anytime-valid
inference. Statistical Science 38(4).

Waudby-Smith and Ramdas (2024). Estimating means of bounded random variables by betting. Journal of
the Royal Statistical Society B 86(1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from os import PathLike
from typing import Any

from graspcast.errors import FormatError, InputError
from graspcast.io.arguments import FLAG, NAME, PATH, a, checked, number, refuse_unless
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.io.json import require

__all__ = ["DriftMonitor"]

_FORMAT = 2
_ALTERNATIVES = 8
_NOTHING = (-math.inf,) * _ALTERNATIVES


@checked(path=PATH, success=FLAG, unit=NAME)
@dataclass
class DriftMonitor:
    """Test a stream of attempts for a success rate below the guaranteed one.

    ::

        monitor = DriftMonitor(rate=0.9, alpha=0.05)
        for success, scene in attempts:
            if monitor.observe(success, unit=scene): ...  # the rate no longer holds

    The wealth is a mixture over eight alternatives (success rates below the guaranteed one) and
    over the start of the drift: a part 1 / (t (t + 1)) is first bet at observation t, so that a
    long time without drift does not delay the alarm.

    Attributes
    ----------
    rate
        The guaranteed success rate.
    alpha
        The probability of ever raising a false alarm, until the monitor is restarted.
    max_attempts_per_unit
        If given, no unit has more attempts, and a unit is weighted by its share of them.
    trials, successes
        Number of attempts since the last restart, and of those that succeeded.
    observations
        Number of closed units, or of trials without a unit.
    alarm_at
        The trial (from 1) after which the alarm was raised; None without alarm. An alarm stays
        until :meth:`restart`.
    restarts
        How often it was restarted. Over k + 1 runs the probability of any false alarm is at most
        (k + 1) alpha.
    unit, unit_trials, unit_successes
        The open unit: the one that further trials may belong to.
    log_wealth
        Logarithm of the wealth bet on each alternative; -inf before the first observation.
    log_max_e_value
        The largest logarithm of the e-value so far.
    """

    rate: float
    alpha: float = 0.05
    max_attempts_per_unit: int | None = None
    trials: int = 0
    successes: int = 0
    observations: int = 0
    alarm_at: int | None = None
    restarts: int = 0
    unit: str | None = None
    unit_trials: int = 0
    unit_successes: int = 0
    log_wealth: tuple[float, ...] = _NOTHING
    log_max_e_value: float = 0.0

    def __post_init__(self) -> None:
        for name in ("rate", "alpha"):
            refuse_unless(number(), getattr(self, name), "DriftMonitor", name)
            if not 0.0 < getattr(self, name) < 1.0:
                raise InputError(
                    f"a monitor's {name} should be above 0 and below 1, not {getattr(self, name)}",
                    parameters=(name,),
                )
        most = a(int, type(None), words="a whole number or None")
        refuse_unless(most, self.max_attempts_per_unit, "DriftMonitor", "max_attempts_per_unit")
        if self.max_attempts_per_unit is not None and self.max_attempts_per_unit < 1:
            raise InputError(
                f"max_attempts_per_unit should be 1 or more, not {self.max_attempts_per_unit}",
                parameters=("max_attempts_per_unit",),
            )

    @property
    def alarm(self) -> bool:
        """Whether the hypothesis that the rate holds has been rejected."""
        return self.alarm_at is not None

    @property
    def log_e_value(self) -> float:
        """Logarithm of the e-value; an alarm is raised when it reaches log(1 / alpha)."""
        not_yet_bet = 1.0 / (self.observations + 1)
        parts = (wealth - math.log(_ALTERNATIVES) for wealth in self.log_wealth)
        return _log_sum((math.log(not_yet_bet), *parts))

    @property
    def e_value(self) -> float:
        """The whole wealth, initially 1; an alarm is raised when it reaches 1 / alpha."""
        return math.exp(min(self.log_e_value, 700.0))

    @property
    def max_e_value(self) -> float:
        """The largest e-value so far."""
        return math.exp(min(self.log_max_e_value, 700.0))

    @property
    def alternatives(self) -> tuple[float, ...]:
        """The success rates that are bet on: from 19/20 to 1/3 of the guaranteed one."""
        nearest, farthest = 0.95, 1.0 / 3.0
        ratio = (farthest / nearest) ** (1.0 / (_ALTERNATIVES - 1))
        return tuple(self.rate * nearest * ratio**i for i in range(_ALTERNATIVES))

    def observe(self, success: bool, unit: str | None = None) -> bool:
        """Add one attempt, and return whether there is an alarm.

        Parameters
        ----------
        success
            Whether the grasp succeeded.
        unit
            Its scene or image; the trials of a unit come one after another. A unit is closed, and
            counts, when the next one begins or at :meth:`close_unit`. None: the trial is its own
            unit.

        Raises
        ------
        InputError
            If a unit has more attempts than ``max_attempts_per_unit``.
        """
        if self.unit is not None and unit != self.unit:
            self.close_unit()
        if unit is not None and self.unit_trials == self.max_attempts_per_unit:
            raise InputError(
                f"unit {unit} has more than {self.max_attempts_per_unit} attempts",
                parameters=("max_attempts_per_unit",),
            )
        self.trials += 1
        self.successes += bool(success)
        if unit is None:
            self._bet(float(bool(success)), 1)
            return self.alarm
        self.unit = unit
        self.unit_trials += 1
        self.unit_successes += bool(success)
        return self.alarm

    def close_unit(self) -> bool:
        """Close the open unit, if there is one, and return whether there is an alarm."""
        if self.unit is not None:
            self._bet(self.unit_successes / self.unit_trials, self.unit_trials)
            self.unit, self.unit_trials, self.unit_successes = None, 0, 0
        return self.alarm

    def restart(self) -> None:
        """Reset e-value and alarm: after a new certification, or when the cause was removed."""
        self.trials = self.successes = self.observations = 0
        self.unit, self.unit_trials, self.unit_successes = None, 0, 0
        self.alarm_at, self.log_max_e_value = None, 0.0
        self.log_wealth = _NOTHING
        self.restarts += 1

    def _bet(self, share: float, attempts: int) -> None:
        """Update the wealth by one observation: the share of successes among some attempts."""
        weight = 1.0
        if self.max_attempts_per_unit is not None:
            weight = attempts / self.max_attempts_per_unit
        self.observations += 1
        first_bet = -math.log(self.observations * (self.observations + 1))
        updated = []
        for wealth, other in zip(self.log_wealth, self.alternatives, strict=True):
            # The likelihood ratio of a success or a failure, averaged over the unit's trials.
            ratio = share * other / self.rate + (1.0 - share) * (1.0 - other) / (1.0 - self.rate)
            updated.append(_log_sum((wealth, first_bet)) + math.log1p(weight * (ratio - 1.0)))
        self.log_wealth = tuple(updated)
        log_e_value = self.log_e_value
        self.log_max_e_value = max(self.log_max_e_value, log_e_value)
        if self.alarm_at is None and log_e_value >= -math.log(self.alpha):
            self.alarm_at = self.trials

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON; a logarithm of -inf is null."""
        wealth = [None if w == -math.inf else w for w in self.log_wealth]
        return {"format": _FORMAT, **asdict(self), "log_wealth": wealth}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any], path: str | PathLike[str]) -> DriftMonitor:
        """Return the monitor that :meth:`as_dict` described; errors name ``path``.

        Raises
        ------
        FormatError
            Naming the entry that is missing or wrong.
        """
        if (found := require(content, "format", path, "top level")) != _FORMAT:
            raise FormatError(
                path,
                f"is a monitor state of format {found}, not {_FORMAT}; start a new one",
                parameters=("state",),
            )
        given = {f.name: require(content, f.name, path, "top level") for f in fields(cls)}
        try:
            given["log_wealth"] = tuple(
                -math.inf if w is None else float(w) for w in given["log_wealth"]
            )
            counts = ("trials", "successes", "observations", "restarts", "unit_trials")
            if any(type(given[name]) is not int or given[name] < 0 for name in counts):
                raise ValueError(f"{', '.join(counts)} should be whole numbers")
            _check_unit(given)
            given["log_max_e_value"] = float(given["log_max_e_value"])
            if len(given["log_wealth"]) != _ALTERNATIVES or any(
                map(math.isnan, given["log_wealth"])
            ):
                raise ValueError(f"log_wealth should have {_ALTERNATIVES} entries")
            return cls(**given)
        except (TypeError, ValueError, OverflowError, InputError) as error:
            raise FormatError(path, f"is not a complete monitor state ({error})") from error

    def save(self, path: str | PathLike[str]) -> None:
        """Write it as JSON, atomically."""
        write_artefact(path, self.as_dict())

    @classmethod
    def load(cls, path: str | PathLike[str]) -> DriftMonitor:
        """Read a file that :meth:`save` wrote.

        Raises
        ------
        FormatError
            Naming the entry that is missing or wrong.
        """
        return cls.from_dict(read_artefact(path, "start a new state", parameters=("state",)), path)


def _log_sum(logs: tuple[float, ...]) -> float:
    """Return the logarithm of the sum of exponentials."""
    top = max(logs)
    return top if top == -math.inf else top + math.log(sum(math.exp(x - top) for x in logs))


def _check_unit(given: Mapping[str, Any]) -> None:
    """Raise ValueError unless the entries on the open unit agree."""
    most = given["max_attempts_per_unit"]
    if not isinstance(given["unit"], str | None) or not isinstance(most, int | None):
        raise ValueError("unit should be text or null, max_attempts_per_unit a number or null")
    trials = given["unit_trials"]
    if (trials > 0) != (given["unit"] is not None) or (most is not None and trials > most):
        raise ValueError(f"unit {given['unit']!r} cannot have {trials} unit_trials")
    if type(given["unit_successes"]) is not int or not 0 <= given["unit_successes"] <= trials:
        raise ValueError("unit_successes should be from 0 to unit_trials")
