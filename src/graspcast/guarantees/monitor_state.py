"""The log of attempts in the field, and how far a monitor has read it.

The log is a table of outcomes that grows at its end. The state says how many of its rows were taken
in, and their digest, so that taking in is repeatable: no attempt counts twice, and none that was
written while nobody looked is lost.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import polars as pl

from graspcast.errors import FormatError, MismatchError
from graspcast.estimates.outcomes import read_outcomes
from graspcast.guarantees.certificate import OVERALL, Guarantee
from graspcast.guarantees.drift_monitor import DriftMonitor
from graspcast.io.hashing import sha256, sha256_of_file
from graspcast.io.json import read_json, require, write_json

__all__ = ["MonitorState"]

_DEFAULT_ALPHA = 0.05


@dataclass
class MonitorState:
    """A monitor's state on disk.

    Attributes
    ----------
    path
        Of the state.
    monitor
        Of one promise.
    promise
        SHA-256 of the promise's file.
    scope
        Which of its promises.
    rows, digest
        How many rows of the log were taken in, and their SHA-256.
    """

    path: Path
    monitor: DriftMonitor
    guarantee: str
    scope: str
    rows: int = 0
    digest: str = ""

    @classmethod
    def open(
        cls,
        path: str | PathLike[str],
        promise_file: str | PathLike[str],
        guarantee: Guarantee,
        *,
        alpha: float | None = None,
        most_attempts: int | None = None,
    ) -> MonitorState:
        """Go on from a state, or begin one.

        Parameters
        ----------
        path
            The state; it need not exist.
        promise_file
            The file that holds the promise.
        promise
            The one to watch.
        alpha
            Chance of a false alarm; 0.05 for a new state if None.
        most_attempts
            As of :class:`DriftMonitor`.

        Raises
        ------
        FormatError
            If the state is not a whole one.
        MismatchError
            If it is that of another promise, or of other settings.
        """
        path = Path(path)
        digest = sha256_of_file(promise_file)
        if not path.exists():
            alpha = _DEFAULT_ALPHA if alpha is None else alpha
            monitor = DriftMonitor(guarantee.rate, alpha, most_attempts)
            return cls(path, monitor, digest, guarantee.scope)
        content = read_json(path, dict)
        names = ("monitor", "guarantee", "scope", "rows", "digest")
        found = {name: require(content, name, path, "top level") for name in names}
        if type(found["rows"]) is not int or found["rows"] < 0:
            raise FormatError(path, f"rows is {found['rows']!r}, not a whole number")
        if (found["guarantee"], found["scope"]) != (digest, guarantee.scope):
            raise MismatchError(
                f"{path}: is the state of another promise ({found['scope']}); give each promise "
                "a --state of its own"
            )
        monitor = DriftMonitor.from_dict(found["monitor"], path)
        for name, wanted in (("alpha", alpha), ("most_attempts", most_attempts)):
            if wanted is not None and wanted != getattr(monitor, name):
                raise MismatchError(
                    f"{path}: was begun with {name.replace('_', '-')} {getattr(monitor, name)}, "
                    f"not {wanted}; leave it out, or begin another --state"
                )
        return cls(path, monitor, digest, guarantee.scope, found["rows"], found["digest"])

    def update(self, log: str | PathLike[str], provenance: Mapping[str, Any]) -> int:
        """Let the monitor see what the log holds beyond the rows that were taken in before.

        Parameters
        ----------
        log
            The attempts, oldest first.
        provenance
            The promise's: its ``principal``, ``gripper`` and ``unit``, if known.

        Returns
        -------
            How many attempts were new.

        Raises
        ------
        FormatError, InputError
            If the log is not a table of outcomes.
        MismatchError
            If it does not begin with the rows that were taken in before, or holds attempts that the
            promise is not about.
        """
        frame = read_outcomes(log)
        for column, key in (("estimator", "principal"), ("gripper", "gripper")):
            others = set(frame[column]) - {provenance.get(key)}
            if key in provenance and others:
                raise MismatchError(
                    f"{log}: holds attempts of {column} {', '.join(sorted(others))}, but the "
                    f"promise is about {provenance[key]}"
                )
        if len(frame) < self.rows or _digest(frame.head(self.rows)) != self.digest:
            raise MismatchError(
                f"{log}: does not begin with the {self.rows} attempts that were taken in before; "
                "the log grows at its end, and what it held stays"
            )
        fresh = frame.slice(self.rows)
        if self.scope != OVERALL:
            name = pl.format("{}-{}", "dataset", "obj_id")
            fresh = fresh.filter(name == self.scope)
        parts = ["dataset", "scene_id", "im_id"][: 3 if provenance.get("unit") == "image" else 2]
        for *unit, success in fresh.select(*parts, "success").iter_rows():
            self.monitor.observe(success == 1, "/".join(map(str, unit)))
        self.rows, self.digest = len(frame), _digest(frame)
        return len(fresh)

    def save(self) -> None:
        """Write the state, whole or not at all."""
        content = {
            "monitor": self.monitor.as_dict(),
            "guarantee": self.guarantee,
            "scope": self.scope,
            "rows": self.rows,
            "digest": self.digest,
        }
        write_json(self.path, content)


def _digest(frame: pl.DataFrame) -> str:
    return sha256(frame.write_csv()) if len(frame) else ""
