"""Interval charts: rates by name as dots with intervals, side by side for two policies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from graspcast.evaluation.bootstrap import Interval
from graspcast.report.axes import Axes, keys_below
from graspcast.report.svg import Drawing, ticks
from graspcast.report.text import shortened

__all__ = ["RateRow", "interval_chart"]

_LEFT, _RIGHT, _ROW, _KEY = 150.0, 20.0, 34.0, 20.0


@dataclass(frozen=True)
class RateRow:
    """A row: its name, and a rate for each series; None where there is none."""

    name: str
    rates: tuple[Interval | None, ...]


def interval_chart(
    title: str, label: str, series: Sequence[str], rows: Sequence[RateRow], *, width: float = 560.0
) -> Markup:
    """Draw rates between 0 and 1.

    Parameters
    ----------
    title
        What it shows, for those who do not see it.
    label
        Of the axis.
    series
        Names of the series, in the order of each row's rates.
    rows
        From top to bottom.
    """
    bottom = 10 + _ROW * len(rows)
    drawing = Drawing(width, bottom + 44 + _KEY * len(series), title)
    area = Axes(drawing, (0.0, 1.0), (0.0, 1.0), _LEFT, width - _RIGHT, 6.0, bottom)
    for value in ticks(0.0, 1.0, 5):
        x = area.x(value)
        drawing.line(x, area.top, x, bottom, "grid")
        drawing.text(x, bottom + 16, f"{value:g}", anchor="m", kind="tick")
    for number, row in enumerate(rows):
        middle = 10 + _ROW * (number + 0.5)
        drawing.text(_LEFT - 10, middle + 4, shortened(row.name, 20), anchor="r", kind="key")
        for k, found in enumerate(row.rates):
            if found is None or found.value != found.value:
                continue
            y = middle + 9.0 * (k - (len(series) - 1) / 2)
            if found.ends is not None:
                ends = [area.x(end) for end in found.ends]
                drawing.line(ends[0], y, ends[1], y, f"whisker s{k}")
            drawing.dot(
                area.x(found.value), y, 5, f"mark s{k}", f"{row.name}, {series[k]}: {found}"
            )
    drawing.text((area.left + area.right) / 2, bottom + 36, label, anchor="m")
    keys = [("dot", f"mark s{k}", name) for k, name in enumerate(series)]
    keys_below(area, keys, from_y=bottom + 46)
    return drawing.markup()
