"""Monitor state: a drift monitor on disk, and how far it has read the attempt log.

The attempt log is a table of outcomes to which rows are appended. The state holds the number of
rows that were read and their digest, so that updating can be repeated: no attempt counts twice, and
none is skipped.
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
from graspcast.io.artefacts import read_artefact, write_artefact
from graspcast.io.hashing import sha256, sha256_of_file
from graspcast.io.json import require

__all__ = ["DEFAULT_ALPHA", "MonitorState", "another_guarantee", "check_settings"]

# Columns of the attempt log, and what the certificate states of them: the first that there is.
_KEPT = {
    "estimator": ("guides", "principal"),
    "gripper": ("gripper",),
    "grasp": ("grasp",),
    "dataset": ("datasets",),
}

DEFAULT_ALPHA = 0.05
"""Probability of ever raising a false alarm, where none is asked for."""


@dataclass
class MonitorState:
    """The state of a monitor of one guarantee, kept in a file.

    Attributes
    ----------
    path
        Of the file.
    monitor
        Of the guarantee.
    certificate
        SHA-256 of the certificate's file.
    scope
        Of the guarantee.
    rows_read
        Number of rows of the attempt log that were read.
    rows_digest
        Their SHA-256.
    """

    path: Path
    monitor: DriftMonitor
    certificate: str
    scope: str
    rows_read: int = 0
    rows_digest: str = ""

    @classmethod
    def open(
        cls,
        path: str | PathLike[str],
        certificate: str | PathLike[str],
        guarantee: Guarantee,
        *,
        alpha: float | None = None,
        max_attempts_per_unit: int | None = None,
    ) -> MonitorState:
        """Read a state, or make a new one if there is no such file.

        Parameters
        ----------
        path
            Of the state.
        certificate
            The file that holds the guarantee.
        guarantee
            The one to monitor.
        alpha
            Probability of a false alarm; for a new state 0.05 if None.
        max_attempts_per_unit
            As for :class:`DriftMonitor`.

        Raises
        ------
        FormatError
            If the file is no complete state.
        MismatchError
            If it is of another guarantee or other settings.
        """
        path = Path(path)
        digest = sha256_of_file(certificate)
        if not path.exists():
            alpha = DEFAULT_ALPHA if alpha is None else alpha
            monitor = DriftMonitor(guarantee.rate, alpha, max_attempts_per_unit)
            return cls(path, monitor, digest, guarantee.scope)
        state = cls._load(path)
        if (state.certificate, state.scope) != (digest, guarantee.scope):
            raise another_guarantee(path, state.scope)
        check_settings(path, state.monitor, alpha, max_attempts_per_unit)
        return state

    @classmethod
    def _load(cls, path: Path) -> MonitorState:
        content = read_artefact(path, "start a new state", parameters=("state",))
        monitor = DriftMonitor.from_dict(require(content, "monitor", path, "top level"), path)
        if "outcomes_read" in content:
            raise MismatchError(
                f"{path}: is the state of a monitor of an attempt log, not of a table; start a new "
                "one",
                parameters=("state", "attempt_log"),
            )
        names = ("certificate", "scope", "rows_read", "rows_digest")
        found = {name: require(content, name, path, "top level") for name in names}
        if type(found["rows_read"]) is not int or found["rows_read"] < 0:
            raise FormatError(path, f"rows_read is {found['rows_read']!r}, not a whole number")
        return cls(path, monitor, **found)

    def update(self, attempt_log: str | PathLike[str], provenance: Mapping[str, Any]) -> int:
        """Add the attempts that were appended to the log since the last update.

        Parameters
        ----------
        attempt_log
            The attempts, oldest first, as a table of outcomes.
        provenance
            The certificate's: its ``guides`` or ``principal``, ``gripper``, ``grasp``, ``datasets``
            and ``unit``, if known.

        Returns
        -------
            How many attempts of the guarantee's scope were added.

        Raises
        ------
        FormatError, InputError
            If the log is not a table of outcomes.
        MismatchError
            If it does not begin with the rows that were read before, or has attempts with another
            estimator or gripper than the certificate's.
        """
        frame = read_outcomes(attempt_log)
        for column, keys in _KEPT.items():
            kept = next((provenance[key] for key in keys if key in provenance), None)
            if kept is None:
                continue
            kept = [kept] if isinstance(kept, str) else kept
            if others := set(frame[column]) - set(kept):
                raise MismatchError(
                    f"{attempt_log}: has attempts of {column} {', '.join(sorted(others))}, but the "
                    f"guarantee is for {', '.join(kept)}",
                    parameters=("attempt_log",),
                )
        if len(frame) < self.rows_read or _digest(frame.head(self.rows_read)) != self.rows_digest:
            raise MismatchError(
                f"{attempt_log}: does not begin with the {self.rows_read} attempts that were read "
                "before; append to the log, and do not change what it has",
                parameters=("attempt_log",),
            )
        new = frame.slice(self.rows_read)
        if self.scope != OVERALL:
            new = new.filter(pl.format("{}-{}", "dataset", "obj_id") == self.scope)
        columns = ["dataset", "scene_id", *(["im_id"] if provenance.get("unit") == "image" else [])]
        for *unit, success in new.select(*columns, "success").iter_rows():
            self.monitor.observe(success == 1, "/".join(map(str, unit)))
        self.rows_read, self.rows_digest = len(frame), _digest(frame)
        return len(new)

    def save(self) -> None:
        """Write it as JSON, atomically."""
        content = {
            "monitor": self.monitor.as_dict(),
            "certificate": self.certificate,
            "scope": self.scope,
            "rows_read": self.rows_read,
            "rows_digest": self.rows_digest,
        }
        write_artefact(self.path, content)


def another_guarantee(path: Path, scope: str) -> MismatchError:
    """Return the error that a state is of another guarantee, whose scope it names."""
    return MismatchError(
        f"{path}: is the state of another guarantee ({scope}); use a state of its own for each",
        parameters=("state",),
    )


def check_settings(
    path: Path, monitor: DriftMonitor, alpha: float | None, max_attempts_per_unit: int | None
) -> None:
    """Check that a monitor that was read has the settings that are wanted; None is any.

    Raises
    ------
    MismatchError
        Naming the setting.
    """
    settings = {"alpha": alpha, "max_attempts_per_unit": max_attempts_per_unit}
    for name, wanted in settings.items():
        if wanted is not None and wanted != getattr(monitor, name):
            raise MismatchError(
                f"{path}: was made with {name} {getattr(monitor, name)}, not {wanted}; leave it "
                "out, or start a new state",
                parameters=(name, "state"),
            )


def _digest(frame: pl.DataFrame) -> str:
    return sha256(frame.write_csv()) if len(frame) else ""
