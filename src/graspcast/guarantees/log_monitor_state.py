"""The state of a monitor of an attempt log, kept in a file: what it says, and how far it has read.

No outcome counts twice and none is skipped, however often the command is run: the state holds the
number of the last outcome that was read, and the log's chain there, by which it is known again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from graspcast.errors import FormatError, MismatchError
from graspcast.guarantees.certificate import OVERALL, Certificate
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.guarantees.log_monitor import LogMonitor, OpenEpisode
from graspcast.guarantees.monitor_state import DEFAULT_ALPHA, another_guarantee, check_settings
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.io.hashing import sha256_of_file
from graspcast.io.json import require

__all__ = ["LogMonitorState"]


@dataclass
class LogMonitorState:
    """A monitor of an attempt log, in a file.

    Attributes
    ----------
    path
        Of the file.
    monitor
        Follows the log.
    certificate
        SHA-256 of the certificate's file.
    """

    path: Path
    monitor: LogMonitor
    certificate: str

    @classmethod
    def open(
        cls,
        path: str | PathLike[str],
        certificate: str | PathLike[str],
        scope: str = OVERALL,
        *,
        alpha: float | None = None,
        max_attempts_per_unit: int | None = None,
    ) -> LogMonitorState:
        """Read a state, or make a new one if there is no such file.

        Parameters
        ----------
        path
            Of the state.
        certificate
            The file that holds the guarantee.
        scope
            Of the guarantee.
        alpha
            Probability of a false alarm; for a new state 0.05 if None.
        max_attempts_per_unit
            As for :class:`~graspcast.guarantees.drift_monitor.DriftMonitor`.

        Raises
        ------
        FormatError
            If the file is no complete state.
        InputError
            If nothing is guaranteed.
        MismatchError
            If it is of another guarantee or other settings, or of a table of attempts.
        """
        path, digest = Path(path), sha256_of_file(certificate)
        monitor = LogMonitor.of(
            Certificate.load(certificate),
            scope,
            alpha=DEFAULT_ALPHA if alpha is None else alpha,
            max_attempts_per_unit=max_attempts_per_unit,
        )
        state = cls(path, monitor, digest)
        if path.exists():
            content = read_artefact(path, "start a new state", parameters=("state",))
            state._take(content)
            check_settings(path, monitor.monitor, alpha, max_attempts_per_unit)
        return state

    def _take(self, content: Mapping[str, Any]) -> None:
        """Take over what a file holds."""
        path, monitor = self.path, self.monitor
        if "rows_read" in content:
            raise MismatchError(
                f"{path}: is the state of a monitor of a table, not of an attempt log; start a new "
                "one",
                parameters=("state", "attempt_log"),
            )
        names = ("certificate", "scope", "outcomes_read", "chain", "open", "counted", "left_out")
        found = {name: require(content, name, path, "top level") for name in names}
        if (found["certificate"], found["scope"]) != (self.certificate, monitor.scope):
            raise another_guarantee(path, found["scope"])
        monitor.monitor = DriftMonitor.from_dict(
            require(content, "monitor", path, "top level"), path
        )
        try:
            monitor.outcomes_read = _count(found["outcomes_read"])
            monitor.chain = str(found["chain"])
            monitor.open_episodes = {
                str(name): OpenEpisode(_count(last), {int(i): bool(held) for i, held in pairs})
                for name, last, pairs in found["open"]
            }
            monitor.counted = {str(name): None for name in found["counted"]}
            monitor.left_out = Counter({str(k): _count(n) for k, n in found["left_out"].items()})
        except (AttributeError, TypeError, ValueError) as error:
            raise FormatError(path, f"is not a complete monitor state ({error})") from error

    def save(self) -> None:
        """Write it as JSON, atomically."""
        monitor = self.monitor
        write_artefact(
            self.path,
            {
                "monitor": monitor.monitor.as_dict(),
                "certificate": self.certificate,
                "scope": monitor.scope,
                "outcomes_read": monitor.outcomes_read,
                "chain": monitor.chain,
                "open": [
                    [name, held.last, [list(pair) for pair in held.held.items()]]
                    for name, held in monitor.open_episodes.items()
                ],
                "counted": list(monitor.counted),
                "left_out": dict(monitor.left_out),
            },
        )


def _count(value: Any) -> int:
    if type(value) is not int or value < 0:
        raise ValueError(f"{value!r} is not a whole number, 0 or more")
    return value
