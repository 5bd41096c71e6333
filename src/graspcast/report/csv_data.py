"""Data behind tables and figures: CSV text that is safe in a spreadsheet, as data: addresses."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Iterable, Sequence

from graspcast.report.text import clean

__all__ = ["csv_text", "data_uri"]

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def csv_text(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table as CSV.

    Text that a spreadsheet would take for a formula gets an apostrophe in front. Numbers stay as
    they are; None is an empty field.
    """
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow([_cell(name) for name in columns])
    writer.writerows([_cell(value) for value in row] for row in rows)
    return out.getvalue()


def _cell(value: object) -> object:
    if isinstance(value, float):
        return "" if value != value else f"{value:.6g}"
    if value is None or isinstance(value, bool | int):
        return value
    text = str(value)
    return f"'{clean(text)}" if text.lstrip(" ").startswith(_FORMULA) else clean(text)


def data_uri(content: str | bytes, kind: str = "text/csv;charset=utf-8") -> str:
    """Return content as a data: address."""
    raw = content.encode() if isinstance(content, str) else content
    return f"data:{kind};base64,{base64.b64encode(raw).decode()}"
