"""Conformance reports: the requirements of an interface, and whether each is met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

__all__ = ["Check", "Report", "UnmetError"]


class UnmetError(Exception):
    """A requirement is not met; the message says what was observed and what to check."""


@dataclass(frozen=True)
class Check:
    """One requirement, whether it is met, and what was observed."""

    name: str
    passed: bool
    detail: str


@dataclass(frozen=True)
class Report:
    """The result of a conformance suite.

    Attributes
    ----------
    subject
        The name of what was checked.
    checks
        The requirements, in the order of the checks.
    """

    kind: ClassVar[str] = "subject"

    subject: str
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every check passed."""
        return all(check.passed for check in self.checks)

    @property
    def failures(self) -> tuple[Check, ...]:
        """The checks that did not pass."""
        return tuple(check for check in self.checks if not check.passed)

    def __str__(self) -> str:
        lines = [f"{self.kind} {self.subject}: {'passed' if self.passed else 'FAILED'}"]
        lines += [f"  {'ok  ' if c.passed else 'FAIL'} {c.name}: {c.detail}" for c in self.checks]
        return "\n".join(lines)
