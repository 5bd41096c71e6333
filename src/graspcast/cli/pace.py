"""Pace of long work: its rate, and how much time is left, in words."""

from __future__ import annotations

import time

from graspcast.io.progress import Count

__all__ = ["Pace", "in_words"]


class Pace:
    """How fast work goes, measured from the first report on.

    What was done before does not count as fast, as in a campaign that is resumed. Where the share
    falls, or other things are counted, other work has begun, and measuring begins anew.
    """

    def __init__(self) -> None:
        self._share, self._began = 0.0, time.monotonic()
        self._start: float | None = None
        self._count: Count | None = None
        self._first = 0

    def report(self, share: float, message: str = "") -> None:
        """Take note of a share from 0 to 1, and of what is counted."""
        count = message if isinstance(message, Count) else None
        if self._start is None or share < self._share or not _same(count, self._count):
            self._start, self._began = share, time.monotonic()
            self._first = count.done if count else 0
        self._share, self._count = share, count

    def seconds_left(self) -> float | None:
        """Return the time left, seconds; None if not known yet."""
        if self._start is None or self._share <= self._start:
            return None
        took = time.monotonic() - self._began
        return took * (1 - self._share) / (self._share - self._start)

    def rate(self) -> str:
        """Return how many are done in a second or a minute; empty if not known yet."""
        took = time.monotonic() - self._began
        if self._count is None or self._count.done <= self._first or took <= 0:
            return ""
        rate = (self._count.done - self._first) / took
        if rate >= 10:
            return f"{rate:,.0f}/s"
        return f"{rate:.1f}/s" if rate >= 1 else f"{60 * rate:.1f}/min"

    def left(self) -> str:
        """Return the time left in words; empty if not known yet."""
        seconds = self.seconds_left()
        return "" if seconds is None else f"{in_words(seconds)} left"


def _same(one: Count | None, other: Count | None) -> bool:
    if one is None or other is None:
        return one is other
    return (one.total, one.things) == (other.total, other.things)


def in_words(seconds: float) -> str:
    """Return a duration in words: ``"50 s"``, ``"12 min"``, ``"3 h 20 min"``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 100:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"
