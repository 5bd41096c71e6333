"""Findings: what is wrong with a file, with its evidence in numbers and its cure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from numpy import ndarray

__all__ = ["SEVERITIES", "Finding", "Severity", "by_severity"]

Severity = Literal["error", "warning", "note"]
SEVERITIES: tuple[Severity, ...] = ("error", "warning", "note")
"""The severities, the gravest first."""


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that is wrong with a file, or odd.

    Attributes
    ----------
    severity
        ``error``: figures from this file would be wrong. ``warning``: probably so, or a part of
        them. ``note``: nothing is wrong, but something is not as it usually is.
    code
        A short name that does not change between versions: ``results-unit``.
    path
        The file or directory.
    message
        What was found, with its numbers.
    cure
        What to do.
    numbers
        The numbers of the message by name.
    repair
        Object's number to the transform that mends its poses, ``est_T_right`` in metres: the right
        pose is ``cam_T_est @ est_T_right``. Empty for other findings.
    estimator
        The estimator whose poses it is about, if there is one.
    """

    severity: Severity
    code: str
    path: str
    message: str
    cure: str
    numbers: Mapping[str, Any] = field(default_factory=dict)
    repair: Mapping[int, Float[ndarray, "4 4"]] = field(default_factory=dict)
    estimator: str = ""

    def __str__(self) -> str:
        return f"{self.severity} {self.code}: {self.path}: {self.sentence} {self.cure}"

    @property
    def sentence(self) -> str:
        """The message with its full stop, or question mark."""
        return self.message if self.message.endswith(("?", ".")) else f"{self.message}."

    def as_dict(self) -> dict[str, Any]:
        """Return the finding as JSON values."""
        out: dict[str, Any] = {
            "severity": self.severity,
            "code": self.code,
            "path": self.path,
            "message": self.message,
            "cure": self.cure,
            "numbers": {name: _plain(value) for name, value in self.numbers.items()},
        }
        if self.estimator:
            out["estimator"] = self.estimator
        if self.repair:
            out["repair"] = {str(i): np.asarray(m).tolist() for i, m in self.repair.items()}
        return out


def _plain(value: Any) -> Any:
    """Return a value without NumPy's types."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return value


def by_severity(findings: Iterable[Finding]) -> list[Finding]:
    """Sort findings, the gravest first; those of one severity stay in the order of the checks."""
    return sorted(findings, key=lambda finding: SEVERITIES.index(finding.severity))
