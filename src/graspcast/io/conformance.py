"""What a conformance suite reports: requirements, whether each is met, and what was seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

__all__ = ["Check", "Report", "UnmetError"]


class UnmetError(Exception):
    """A requirement is not met; the message says what was seen and what to look at."""


@dataclass(frozen=True)
class Check:
    """One requirement, whether it is met, and what was seen."""

    name: str
    passed: bool
    detail: str


@dataclass(frozen=True)
class Report:
    """What a suite found, in the order in which it looked.

    Attributes
    ----------
    subject
        What was looked at.
    checks
        The requirements.
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
