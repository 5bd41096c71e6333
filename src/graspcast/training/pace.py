"""Pace of long work: how much time is left, in words."""

from __future__ import annotations

import time

__all__ = ["Pace", "in_words"]


class Pace:
    """The time that work takes, measured from when this is made.

    Parameters
    ----------
    start
        The share that was done before.
    """

    def __init__(self, start: float = 0.0):
        self._start, self._began = start, time.monotonic()

    def left(self, share: float) -> str:
        """Return the time left in words, if a share from 0 to 1 is done; empty if not known yet."""
        if share <= self._start:
            return ""
        took = time.monotonic() - self._began
        return f"{in_words(took * (1 - share) / (share - self._start))} left"


def in_words(seconds: float) -> str:
    """Return a duration in words: ``"50 s"``, ``"12 min"``, ``"3 h 20 min"``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 100:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"
