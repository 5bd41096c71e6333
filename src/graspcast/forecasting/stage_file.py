"""The CSV file of verdicts after each look at recorded images."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from os import PathLike

from graspcast.errors import FormatError
from graspcast.forecasting.verdict import InstanceLooks, VerdictRow
from graspcast.forecasting.verdict_file import COLUMNS, read_rows, verdict_fields
from graspcast.io.arguments import PATH, a, checked, sequence
from graspcast.io.files import write_text

__all__ = ["STAGE_COLUMNS", "read_stages", "write_stages"]

_MORE = ("instance", "looks", "ended")
STAGE_COLUMNS = (*COLUMNS, *_MORE)
"""The columns: those of a verdicts file, and which instance, after how many looks, and whether
looking ended there (``yes`` or ``no``).

``instance`` numbers the instances from 0; ``est_id`` is each guide's own. An instance has as many
rows as there were images of it, or looks were allowed.
"""


@checked(path=PATH, looks=sequence(a(InstanceLooks)))
def write_stages(path: str | PathLike[str], looks: Sequence[InstanceLooks]) -> None:
    """Write the verdicts after each look as CSV, atomically."""
    rows = [row for each in looks for row in each.rows]
    more = [
        [number, taken, "yes" if taken == each.ended else "no"]
        for number, each in enumerate(looks)
        for taken in range(1, len(each.rows) + 1)
    ]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(STAGE_COLUMNS)
    writer.writerows([*one, *two] for one, two in zip(verdict_fields(rows), more, strict=True))
    write_text(path, out.getvalue())


@checked(path=PATH)
def read_stages(path: str | PathLike[str]) -> list[InstanceLooks]:
    """Read what :func:`write_stages` wrote, in the order of the instances' numbers.

    Raises
    ------
    FormatError
        Naming the line: for values that are none, looks that are missing or there twice, rows of
        one number that are of different objects, images or grippers, and for looking that
        did not end where the verdicts say.
    """
    found: dict[int, dict[int, tuple[VerdictRow, bool, str]]] = {}
    for row, fields, where in read_rows(path, more=_MORE):
        number, taken = (_count(fields[name], name, path, where) for name in _MORE[:2])
        if fields["ended"] not in ("yes", "no"):
            raise FormatError(path, f"ended is {fields['ended']!r}, not yes or no", where=where)
        looks = found.setdefault(number, {})
        if taken in looks:
            raise FormatError(
                path, f"{looks[taken][2]} is of the same instance and look", where=where
            )
        first = next(iter(looks.values()), None)
        if first is not None and _place(first[0]) != _place(row):
            raise FormatError(
                path,
                f"instance {number} is another object, image or gripper than in {first[2]}",
                where=where,
            )
        looks[taken] = row, fields["ended"] == "yes", where
    return [_looks(number, found[number], path) for number in sorted(found)]


def _looks(
    number: int, rows: dict[int, tuple[VerdictRow, bool, str]], path: str | PathLike[str]
) -> InstanceLooks:
    count = len(rows)
    if sorted(rows) != list(range(1, count + 1)):
        have = ", ".join(map(str, sorted(rows)))
        raise FormatError(
            path, f"instance {number} has looks {have}, not all from 1 to {max(rows)}"
        )
    ended = [looks for looks in rows if rows[looks][1]]
    again = [looks for looks in rows if rows[looks][0].verdict.look is not None]
    asked = min(set(range(1, count + 1)).difference(again), default=count)
    if ended != [asked]:
        raise FormatError(
            path,
            f"by the verdicts on instance {number} looking ends after look {asked}, but ended is "
            f"yes after {', '.join(map(str, sorted(ended))) or 'none'}",
        )
    return InstanceLooks(tuple(rows[looks][0] for looks in range(1, count + 1)), asked)


def _place(row: VerdictRow) -> tuple[object, ...]:
    """Return what all looks of an instance share; ``est_id`` is each guide's own."""
    return (*row.key[:4], row.gripper)


def _count(text: str, name: str, path: str | PathLike[str], where: str) -> int:
    if not (text.isascii() and text.isdecimal()) or len(text) > 9:
        raise FormatError(path, f"{name} is {text!r}, not a whole number", where=where)
    return int(text)
