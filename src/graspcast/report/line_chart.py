"""Line charts: curves of rates, points with intervals on a diagonal, and marked points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from graspcast.report.axes import axes, keys_below

__all__ = ["Curve", "Mark", "curves_chart", "diagonal_chart"]

_SIZE = (440.0, 300.0)


@dataclass(frozen=True)
class Curve:
    """A curve: its name, and its points."""

    name: str
    points: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Mark:
    """A marked point, or with ``x`` None a level across the chart.

    Attributes
    ----------
    name
        What it is; marks of one name share a key.
    x, y
        Where.
    curve
        The number of its curve, whose colour it has; None for none.
    shape
        ``dot`` or ``diamond``.
    """

    name: str
    x: float | None
    y: float
    curve: int | None = None
    shape: str = "dot"


def curves_chart(
    title: str,
    x_label: str,
    y_label: str,
    curves: Sequence[Curve],
    marks: Sequence[Mark] = (),
    *,
    y_most: float = 1.0,
) -> Markup:
    """Draw curves of shares over shares, with marked points."""
    named = list(dict.fromkeys((m.name, m.shape, m.x is None) for m in marks))
    area = axes(
        title,
        x_label,
        y_label,
        y_range=(0.0, y_most),
        size=_SIZE,
        keys=len(curves) + len(named),
    )
    for mark in marks:
        if mark.x is None:
            y = area.y(mark.y)
            area.drawing.line(area.left, y, area.right, y, "level")
    for number, curve in enumerate(curves):
        places = [(area.x(x), area.y(y)) for x, y in curve.points]
        area.drawing.path(places, f"curve s{number % 6}")
    for mark in marks:
        if mark.x is None:
            continue
        kind = f"mark s{(mark.curve or 0) % 6}" if mark.curve is not None else "mark plain"
        told = f"{mark.name}: {mark.x:.3f}, {mark.y:.3f}"
        place = area.x(mark.x), area.y(mark.y)
        if mark.shape == "diamond":
            area.drawing.diamond(*place, 7, kind, told)
        else:
            area.drawing.dot(*place, 5.5, kind, told)
    keys = [("line", f"curve s{n % 6}", curve.name) for n, curve in enumerate(curves)]
    keys += [
        ("line", "level", name) if across else (shape, "mark plain", name)
        for name, shape, across in named
    ]
    keys_below(area, keys, from_y=_SIZE[1])
    return area.drawing.markup()


def diagonal_chart(
    title: str,
    x_label: str,
    y_label: str,
    points: Sequence[tuple[float, float, float, float, int]],
) -> Markup:
    """Draw points with intervals beside the diagonal on which they should lie.

    Parameters
    ----------
    title, x_label, y_label
        As for :func:`graspcast.report.axes.axes`.
    points
        x, y, lower and upper end (NaN for none), and of how many each is.
    """
    area = axes(title, x_label, y_label, size=(380.0, 340.0))
    drawing = area.drawing
    drawing.line(area.x(0), area.y(0), area.x(1), area.y(1), "level")
    largest = max((count for *_, count in points), default=1)
    for x, y, low, high, count in points:
        at = area.x(x)
        if low == low:
            drawing.line(at, area.y(low), at, area.y(high), "whisker s0")
        radius = 3.0 + 4.0 * (count / largest) ** 0.5
        told = f"{count} grasps: forecast {x:.3f}, succeed {y:.3f}"
        drawing.dot(at, area.y(y), radius, "mark s0", told)
    return drawing.markup()
