"""Numbers given as options: parsed, and refused where they are out of range."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

__all__ = ["number_type"]


def number_type(accepts: Callable[[float], bool], needed: str) -> Callable[[str], float]:
    """Return a parser of an option's number, for ``type=`` of argparse.

    Parameters
    ----------
    accepts
        Whether a number is one that the option takes; what is no number is NaN.
    needed
        What is needed, for the message: "degrees from 0 to 180 are".
    """

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not accepts(value):
            raise argparse.ArgumentTypeError(f"{needed} needed, not {text!r}")
        return value

    return parse
