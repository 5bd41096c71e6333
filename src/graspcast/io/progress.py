"""Progress callbacks: called with the share of the work that is done and a short message."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Count", "Progress", "step_of"]

Progress = Callable[[float, str], None]
"""Called with the share done, in [0, 1], and what is being worked on (may be empty).

The message may be a :class:`Count`.
"""


class Count(str):
    """A message that says how many are done: ``"1,240 of 5,000 trials"``.

    Parameters
    ----------
    done, total
        How many of how many.
    things
        What is counted, in the plural.
    more
        Further words.

    Attributes
    ----------
    done, total, things, more
        As given.
    """

    done: int
    total: int
    things: str
    more: str

    def __new__(cls, done: int, total: int, things: str, more: str = "") -> Count:
        """Make the text."""
        text = f"{done:,} of {total:,} {things}"
        count = super().__new__(cls, f"{text}, {more}" if more else text)
        count.done, count.total, count.things, count.more = done, total, things, more
        return count

    @property
    def share(self) -> float:
        """Which share of them is done; 1 where there are none."""
        return self.done / self.total if self.total else 1.0


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
