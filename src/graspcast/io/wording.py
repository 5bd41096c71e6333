"""Wording: numbers of things in messages."""

from __future__ import annotations

__all__ = ["counted"]


def counted(number: int, noun: str, one: str = "", several: str = "") -> str:
    """Return a number with its noun, and a verb that agrees: ``1 view has``, ``2 views have``.

    Parameters
    ----------
    number
        How many.
    noun
        In the singular; its plural ends in ``s``.
    one, several
        The verb for one and for several, if any.
    """
    alone = number == 1
    verb = one if alone else several
    return f"{number} {noun}{'' if alone else 's'}{' ' if verb else ''}{verb}"
