"""Monitoring of a guarantee by an attempt log, live: outcomes come late and out of order.

The unit is the episode, a scene: its attempts count together (:mod:`.drift_monitor`). Outcomes are
read in the log's own order. An episode is counted when an outcome of another one comes and those of
all its attempts are there, or when 100 outcomes have come since its last. An outcome that comes
after its episode was counted is left out; how many is told, since failures that are reported late
would hide a drift.
"""

from __future__ import annotations

import threading
from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Any

from graspcast.attempt_log.log import AttemptLog
from graspcast.errors import InputError, MismatchError
from graspcast.guarantees.certificate import OVERALL, Certificate
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.guarantees.logged_attempts import (
    LoggedOutcome,
    Scope,
    attempted_instances,
    outcomes_after,
)
from graspcast.guarantees.monitor_state import DEFAULT_ALPHA
from graspcast.io.arguments import a, checked

__all__ = ["LogMonitor", "MonitorStatus", "OpenEpisode", "monitor_status"]

_PATIENCE = 100
_REMEMBERED = 10_000
_LATE = "its episode was counted before it came"
_TWICE = "a further grasp of the same instance"
_START = ""


@dataclass(frozen=True)
class MonitorStatus:
    """What a monitor says.

    Attributes
    ----------
    scope
        Of the guarantee.
    alarm
        Whether the guaranteed rate no longer holds.
    alarm_at
        The attempt after which the alarm was raised, or None.
    e_value, max_e_value
        The evidence against the rate, now and at most; the alarm is raised at 1 / ``alpha``.
    attempts, successes
        Those that counted.
    waiting
        Outcomes of episodes that are not complete.
    rate
        The guaranteed success rate.
    alpha
        Probability of ever raising a false alarm.
    outcomes_read
        The last outcome that was read.
    left_out
        Why outcomes did not count, to how many.
    """

    scope: str
    alarm: bool
    alarm_at: int | None
    e_value: float
    max_e_value: float
    attempts: int
    successes: int
    waiting: int
    rate: float
    alpha: float
    outcomes_read: int
    left_out: dict[str, int]

    @property
    def message(self) -> str:
        """The status in one sentence or two."""
        head = f"ALARM since attempt {self.alarm_at}" if self.alarm else "no alarm"
        rate = f"{self.successes / self.attempts:.3f}" if self.attempts else "-"
        return (
            f"{self.scope}: {head}. {self.attempts} attempts, success rate {rate}; guaranteed: "
            f"{self.rate:g}. E-value {self.e_value:.3g} (at most {self.max_e_value:.3g} so far); "
            f"the alarm is raised at {1 / self.alpha:g}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)


@dataclass
class OpenEpisode:
    """The outcomes of an episode that is not counted yet.

    Attributes
    ----------
    last
        The number of its last outcome.
    held
        Instance to whether its grasp held.
    """

    last: int
    held: dict[int, bool]


@dataclass
class LogMonitor:
    """A drift monitor that follows an attempt log.

    ::

        monitor = LogMonitor.of(Certificate.load("certificate.json"))
        status = monitor.update(log)  # reads what is new
        if status.alarm: ...

    Several threads may update one monitor.

    Attributes
    ----------
    monitor
        Of the guarantee.
    scope
        Of the guarantee.
    belongs
        Which attempts the guarantee is about.
    outcomes_read, chain
        The last outcome that was read, and the log's chain there, hexadecimal.
    open_episodes
        By id, in the order of their first outcome.
    counted
        The last episodes that were counted.
    left_out
        Why outcomes did not count, to how many.
    """

    monitor: DriftMonitor
    scope: str
    belongs: Scope
    outcomes_read: int = 0
    chain: str = _START
    open_episodes: dict[str, OpenEpisode] = field(default_factory=dict)
    counted: dict[str, None] = field(default_factory=dict)
    left_out: Counter[str] = field(default_factory=Counter)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False, compare=False)

    @classmethod
    @checked(certificate=a(Certificate))
    def of(
        cls,
        certificate: Certificate,
        scope: str = OVERALL,
        *,
        alpha: float = DEFAULT_ALPHA,
        max_attempts_per_unit: int | None = None,
    ) -> LogMonitor:
        """Return a new monitor of one of a certificate's guarantees.

        Parameters
        ----------
        certificate, scope
            The guarantee, of all objects or of one (``ycbv-5``).
        alpha, max_attempts_per_unit
            As for :class:`~graspcast.guarantees.drift_monitor.DriftMonitor`.

        Raises
        ------
        InputError
            If nothing is guaranteed.
        UnknownNameError
            If there is no such scope.
        """
        guarantee = certificate.of(scope)
        if guarantee.threshold is None:
            raise InputError(
                f"the certificate guarantees nothing ({guarantee}), so there is no rate to monitor",
                parameters=("certificate",),
            )
        monitor = DriftMonitor(guarantee.rate, alpha, max_attempts_per_unit)
        return cls(monitor, scope, Scope.of(certificate, scope))

    def update(self, log: AttemptLog) -> MonitorStatus:
        """Read the outcomes that were added to a log since the last update.

        Parameters
        ----------
        log
            Open for reading or writing, always the same one.

        Raises
        ------
        MismatchError
            If it is another log than before.
        """
        with self._lock, log.reading() as connection:
            if self.outcomes_read:
                found = connection.execute(
                    "SELECT chain FROM outcome WHERE seq = ?", (self.outcomes_read,)
                ).fetchone()
                if found is None or found[0].hex() != self.chain:
                    raise MismatchError(
                        f"{log.path}: is not the log that was read before: outcome "
                        f"{self.outcomes_read} is another; give that log, or start a new state",
                        parameters=("attempt_log", "state"),
                    )
            for outcome in outcomes_after(connection, self.outcomes_read):
                episode = outcome.decision.episode
                if why := self.belongs.why_not(outcome.decision):
                    self.left_out[why] += 1
                else:
                    for other, held in list(self.open_episodes.items()):
                        done = other != episode and (
                            outcome.seq - held.last > _PATIENCE
                            or attempted_instances(
                                connection, self.belongs, other, outcome.decisions
                            )
                            <= held.held.keys()
                        )
                        if done:
                            self._count(other)
                    self._add(outcome)
                self.outcomes_read, self.chain = outcome.seq, outcome.chain.hex()
            return self.status

    def close_episodes(self) -> None:
        """Count all episodes: no further outcomes of theirs are to come."""
        with self._lock:
            for episode in list(self.open_episodes):
                self._count(episode)

    def restart(self) -> None:
        """Reset evidence and alarm; outcomes that were read before do not count again."""
        with self._lock:
            self.counted.update(dict.fromkeys(self.open_episodes))
            self.open_episodes.clear()
            self.left_out.clear()
            self.monitor.restart()

    @property
    def status(self) -> MonitorStatus:
        """What the monitor says."""
        m = self.monitor
        return MonitorStatus(
            scope=self.scope,
            alarm=m.alarm,
            alarm_at=m.alarm_at,
            e_value=m.e_value,
            max_e_value=m.max_e_value,
            attempts=m.trials,
            successes=m.successes,
            waiting=sum(len(held.held) for held in self.open_episodes.values()),
            rate=m.rate,
            alpha=m.alpha,
            outcomes_read=self.outcomes_read,
            left_out=dict(sorted(self.left_out.items())),
        )

    def _add(self, outcome: LoggedOutcome) -> None:
        episode, instance = outcome.decision.episode, outcome.decision.instance
        if episode in self.counted:
            self.left_out[_LATE] += 1
            return
        held = self.open_episodes.setdefault(episode, OpenEpisode(outcome.seq, {}))
        held.last = outcome.seq
        if instance in held.held:
            self.left_out[_TWICE] += 1
            return
        held.held[instance] = outcome.success

    def _count(self, episode: str) -> None:
        """Count an episode as one unit, and remember the last ones that were counted."""
        held, most = self.open_episodes[episode].held, self.monitor.max_attempts_per_unit
        if most is not None and len(held) > most:
            raise InputError(
                f"episode {episode} has {len(held)} attempts, more than {most}",
                parameters=("max_attempts_per_unit",),
            )
        del self.open_episodes[episode]
        for success in held.values():
            self.monitor.observe(success, episode)
        self.monitor.close_unit()
        self.counted[episode] = None
        while len(self.counted) > _REMEMBERED:
            del self.counted[next(iter(self.counted))]


def monitor_status(
    log: AttemptLog, certificate: Certificate, scope: str = OVERALL, *, alpha: float = DEFAULT_ALPHA
) -> MonitorStatus:
    """Return what a monitor of a guarantee says of a whole log.

    What asks again and again keeps a :class:`LogMonitor`, which reads only what is new.

    Parameters
    ----------
    log
        Open for reading or writing.
    certificate, scope, alpha
        As for :meth:`LogMonitor.of`.
    """
    return LogMonitor.of(certificate, scope, alpha=alpha).update(log)
