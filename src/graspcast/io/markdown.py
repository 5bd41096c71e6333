"""Markdown tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

__all__ = ["table"]


def table(header: Sequence[str], rows: Iterable[Sequence[object]], *, text_columns: int = 1) -> str:
    """Format a Markdown table with aligned columns.

    Parameters
    ----------
    header
        The columns' names.
    rows
        As many cells each.
    text_columns
        The number of columns, from the first, that are aligned to the left; the others are
        aligned to the right.

    Returns
    -------
    The table's lines, without a line end after the last.
    """
    cells = [list(header), *([str(cell) for cell in row] for row in rows)]
    width = [max(len(row[i]) for row in cells) for i in range(len(header))]

    def line(row: Sequence[str]) -> str:
        padded = [
            c.ljust(w) if i < text_columns else c.rjust(w)
            for i, (c, w) in enumerate(zip(row, width, strict=True))
        ]
        return "| " + " | ".join(padded) + " |"

    rule = ["-" * w if i < text_columns else "-" * (w - 1) + ":" for i, w in enumerate(width)]
    return "\n".join([line(cells[0]), line(rule), *map(line, cells[1:])])
