"""Text of reports: names from files made harmless, and numbers in few digits."""

from __future__ import annotations

import re

from graspcast.evaluation.bootstrap import Interval

__all__ = ["clean", "rate", "shortened", "spread"]

# Control characters, and those that turn the direction of what follows them.
_UNSEEN = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def clean(text: object) -> str:
    """Return text with a replacement character for what cannot be shown or encoded."""
    encoded = str(text).encode("utf-8", errors="replace").decode()
    return _UNSEEN.sub("\ufffd", encoded)


def shortened(text: object, most: int = 24) -> str:
    """Return text of at most so many letters: what is longer lacks its middle."""
    whole = clean(text)
    if len(whole) <= most:
        return whole
    return f"{whole[: (most - 1) // 2]}…{whole[-(most // 2) :]}"


def rate(value: float | None) -> str:
    """Return a rate or a score with three decimals; a dash for none."""
    return "-" if value is None or value != value else f"{value:.3f}"


def spread(interval: Interval | None) -> str:
    """Return an interval's ends; empty where they are not known."""
    if interval is None or interval.ends is None:
        return ""
    return "[{:.3f}, {:.3f}]".format(*interval.ends)
