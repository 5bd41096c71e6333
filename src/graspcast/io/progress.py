"""Progress callbacks: called with the share of the work that is done and a short message."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Progress", "step_of"]

Progress = Callable[[float, str], None]
"""Called with the share done, in [0, 1], and what is being worked on (may be empty)."""


def step_of(
    progress: Progress | None, step: int, steps: int, message: str | None = None
) -> Progress:
    """Return a callback for one of several steps of equal size.

    Parameters
    ----------
    progress
        The callback for all steps together; None ignores every call.
    step, steps
        Number of this step, from 0, and of all steps.
    message
        Passed on in place of the step's own messages.
    """

    def report(share: float, text: str) -> None:
        if progress is not None:
            progress((step + share) / steps, text if message is None else message)

    return report
