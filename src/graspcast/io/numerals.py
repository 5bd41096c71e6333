"""Numbers as text: what files write, which is less than what Python reads."""

from __future__ import annotations

from typing import Any

__all__ = ["plain"]


def plain(cell: Any) -> Any:
    """Return a cell whose text may be a number, or several.

    ``int`` and ``float`` also take ``1_0`` for 10, and digits of other scripts; no program writes
    these for numbers, so such a cell is damaged or something else.

    Raises
    ------
    ValueError
        If it is text that holds an underscore, or anything beyond ASCII.
    """
    if isinstance(cell, str) and ("_" in cell or not cell.isascii()):
        raise ValueError(f"{cell!r} is no number")
    return cell
