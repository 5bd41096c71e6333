"""Axes of charts: from values to places in a drawing, with grid lines and labels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from graspcast.report.svg import Drawing, Number, ticks

__all__ = ["Axes", "axes", "keys_below"]

_LEFT, _RIGHT, _TOP, _BOTTOM = 52.0, 14.0, 12.0, 46.0
_ROW = 20.0


@dataclass(frozen=True)
class Axes:
    """The area of a chart in which values are drawn.

    Attributes
    ----------
    drawing
        Where to draw.
    x_range, y_range
        The values at its ends.
    left, right, top, bottom
        Its sides in the drawing.
    """

    drawing: Drawing
    x_range: tuple[Number, Number]
    y_range: tuple[Number, Number]
    left: float
    right: float
    top: float
    bottom: float

    def x(self, value: Number) -> float:
        """Return where a value lies from left to right; beyond the ends, at the end."""
        return self._at(value, self.x_range, self.left, self.right)

    def y(self, value: Number) -> float:
        """Return where a value lies from top to bottom."""
        return self._at(value, self.y_range, self.bottom, self.top)

    @staticmethod
    def _at(value: Number, ends: tuple[Number, Number], start: float, end: float) -> float:
        share = (value - ends[0]) / (ends[1] - ends[0])
        return start + min(max(share, 0.0), 1.0) * (end - start)


def axes(
    title: str,
    x_label: str,
    y_label: str,
    *,
    x_range: tuple[Number, Number] = (0.0, 1.0),
    y_range: tuple[Number, Number] = (0.0, 1.0),
    size: tuple[Number, Number] = (440.0, 300.0),
    keys: int = 0,
    x_ticks: Sequence[float] | None = None,
    told: Callable[[float], str] = "{:g}".format,
) -> Axes:
    """Begin a drawing with two axes.

    Parameters
    ----------
    title
        What the chart shows, for those who do not see it.
    x_label, y_label
        What the axes are, with units.
    x_range, y_range
        The values at the ends.
    size
        Width and height, without the keys.
    keys
        Rows of keys that are to stand below.
    x_ticks
        Where to label the x axis; round numbers if None.
    told
        Words for a value on the x axis.
    """
    width, height = size
    drawing = Drawing(width, height + keys * _ROW, title)
    area = Axes(drawing, x_range, y_range, _LEFT, width - _RIGHT, top=_TOP, bottom=height - _BOTTOM)
    for value in ticks(*y_range):
        y = area.y(value)
        drawing.line(area.left, y, area.right, y, "grid")
        drawing.text(area.left - 6, y + 4, f"{value:g}", anchor="r", kind="tick")
    for value in ticks(*x_range) if x_ticks is None else x_ticks:
        x = area.x(value)
        drawing.line(x, area.bottom, x, area.bottom + 4, "axis")
        drawing.text(x, area.bottom + 17, told(value), anchor="m", kind="tick")
    drawing.line(area.left, area.bottom, area.right, area.bottom, "axis")
    drawing.text((area.left + area.right) / 2, height - 10, x_label, anchor="m")
    drawing.turned(14, (area.top + area.bottom) / 2, y_label)
    return area


def keys_below(area: Axes, keys: Sequence[tuple[str, str, str]], *, from_y: Number) -> None:
    """Write what the marks mean, one a row.

    Parameters
    ----------
    area
        Of the chart.
    keys
        Shape (``line``, ``dot``, ``diamond`` or ``bar``), class, and words.
    from_y
        Where the rows begin.
    """
    drawing = area.drawing
    for row, (shape, kind, words) in enumerate(keys):
        y = from_y + row * _ROW + 6
        x = area.left + 10
        if shape == "line":
            drawing.line(x - 10, y, x + 10, y, kind)
        elif shape == "dot":
            drawing.dot(x, y, 4.5, kind)
        elif shape == "diamond":
            drawing.diamond(x, y, 6, kind)
        else:
            drawing.bar(x - 10, y - 5, 20, 10, kind)
        drawing.text(x + 18, y + 4, words, kind="key")
