"""Lines of a results CSV, with or without a header, with R and t in one field or in several."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from operator import itemgetter
from pathlib import Path

from graspcast.bop.results_rows import COLUMNS
from graspcast.errors import FormatError

__all__ = ["csv_rows", "is_results_csv"]

_Fields = tuple[str, ...]

_FIRST_LINE = f"the first line of a results file is {','.join(COLUMNS)}"
_SPREAD = len(COLUMNS) + 8 + 2
"""The number of fields where the numbers of R and t are separated by commas, too."""


def csv_rows(path: Path, text: str) -> Iterator[tuple[int, _Fields | None]]:
    """Yield the line number and the fields of ``COLUMNS`` of each row.

    - Without a header the columns are BOP's, in their order; the last, time, may be missing.
    - The nine numbers of R and the three of t may be separated by commas, with or without quotes
      and brackets.
    - Fields may be separated by semicolons or tabs.

    Parameters
    ----------
    path
        The file, for messages.
    text
        Its content.

    Yields
    ------
    Line number and fields; None instead of the fields where there are too few or too many.

    Raises
    ------
    FormatError
        If it is no CSV file, or columns are missing in the header.
    """
    try:
        with io.StringIO(text, newline="") as stream:
            reader = csv.reader(stream, strict=True, delimiter=_delimiter(text))
            first = next(reader, [])
            header = [name.strip() for name in first]
            if _is_row(first):
                header = list(COLUMNS if len(first) in (len(COLUMNS), _SPREAD) else COLUMNS[:-1])
                yield reader.line_num, _pick(header)(first)
            pick = _pick(_checked(header, path))
            for fields in reader:
                if fields:
                    yield reader.line_num, pick(fields)
    except csv.Error as error:
        raise FormatError(path, f"is not a CSV file ({error})") from error


def is_results_csv(text: str) -> bool:
    """Return whether text begins as a results CSV does: with some of its columns, or a row."""
    try:
        first = next(csv.reader(io.StringIO(text, newline=""), delimiter=_delimiter(text)), [])
    except csv.Error:
        return True  # which reading it will explain
    return _is_row(first) or any(name.strip() in COLUMNS for name in first)


def _delimiter(text: str) -> str:
    """Return what separates the fields of the first line."""
    first = text.lstrip().partition("\n")[0]
    return next((mark for mark in ";\t" if first.count(mark) >= len(COLUMNS) - 2), ",")


def _is_row(fields: list[str]) -> bool:
    """Return whether this line is no header, but the first row of a file without one."""
    whole = (field.strip().isdecimal() for field in fields[:3])
    widths = (len(COLUMNS), len(COLUMNS) - 1, _SPREAD, _SPREAD - 1)
    return len(fields) in widths and all(whole)


def _checked(header: list[str], path: Path) -> list[str]:
    missing = [name for name in COLUMNS[:-1] if name not in header]
    if missing:
        raise FormatError(
            path,
            f"no column {', '.join(map(repr, missing))}; found {', '.join(header) or 'none'}; "
            f"{_FIRST_LINE}",
            where="line 1",
        )
    return header


def _pick(header: list[str]) -> Callable[[list[str]], _Fields | None]:
    """Return the function that picks the fields of ``COLUMNS`` from a row."""
    unknown = () if "time" in header else ("-1",)
    wanted = itemgetter(*(header.index(name) for name in COLUMNS if name in header))
    in_order = header in (list(COLUMNS), list(COLUMNS[:-1]))

    def pick(fields: list[str]) -> _Fields | None:
        if in_order and len(fields) == len(header) + _SPREAD - len(COLUMNS):
            fields = [*fields[:4], " ".join(fields[4:13]), " ".join(fields[13:16]), *fields[16:]]
        return (*wanted(fields), *unknown) if len(fields) == len(header) else None

    return pick
