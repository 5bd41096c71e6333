"""Tolerance maps: how far off a pose may be in each direction until a grasp fails."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from graspcast.report.axes import Axes, keys_below
from graspcast.report.svg import Drawing, ticks

__all__ = ["ReachRow", "reach_chart"]

_LEFT, _RIGHT, _ROW, _WIDTH = 130.0, 20.0, 34.0, 440.0


@dataclass(frozen=True)
class ReachRow:
    """One axis: its name, and both directions, each with 90 % (value, low, high) and 50 %."""

    name: str
    back: tuple[float, float, float, float]
    forth: tuple[float, float, float, float]


def reach_chart(title: str, unit: str, rows: Sequence[ReachRow]) -> Markup:
    """Draw reaches to both sides of zero.

    Parameters
    ----------
    title
        What it shows, for those who do not see it.
    unit
        Of the values.
    rows
        One for each axis.
    """
    most = max(max(*row.back, *row.forth) for row in rows) or 1.0
    bottom = 10 + _ROW * len(rows)
    drawing = Drawing(_WIDTH, bottom + 40 + 40, title)
    area = Axes(drawing, (-most, most), (0.0, 1.0), _LEFT, _WIDTH - _RIGHT, 6.0, bottom)
    for value in ticks(-most, most, 6):
        x = area.x(value)
        drawing.line(x, area.top, x, bottom, "grid")
        drawing.text(x, bottom + 16, f"{value:g}", anchor="m", kind="tick")
    zero = area.x(0.0)
    for number, row in enumerate(rows):
        y = 10 + _ROW * (number + 0.5)
        drawing.text(_LEFT - 10, y + 4, row.name, anchor="r", kind="key")
        for sign, (ninety, low, high, half) in ((-1, row.back), (1, row.forth)):
            for value, kind in ((half, "bar pale"), (ninety, "bar s2")):
                ends = sorted((zero, area.x(sign * value)))
                told = f"{row.name}: {sign * value:.3g} {unit}"
                drawing.bar(ends[0], y - 9, ends[1] - ends[0], 18, kind, told)
            drawing.line(area.x(sign * low), y, area.x(sign * high), y, "whisker plain")
    drawing.line(zero, area.top, zero, bottom, "axis")
    drawing.text((area.left + area.right) / 2, bottom + 34, f"error, {unit}", anchor="m")
    keys = [("bar", "bar s2", "90 % succeed, with its interval"), ("bar", "bar pale", "50 %")]
    keys_below(area, keys, from_y=bottom + 44)
    return drawing.markup()
