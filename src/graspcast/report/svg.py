"""Drawing of charts as SVG elements, whose colours are the page's, in light and in the dark."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from markupsafe import Markup

from graspcast.report.text import clean

__all__ = ["Drawing", "Number", "ticks"]

Number = float | int
_ANCHORS = {"l": "start", "m": "middle", "r": "end"}


class Drawing:
    """An SVG picture.

    Shapes name classes of the page's style sheet, which gives them colours; they have none of their
    own. Text is text, so that it can be found and read aloud.

    Parameters
    ----------
    width, height
        In units of about a pixel; the page scales it.
    title
        What it shows, for those who do not see it.
    """

    def __init__(self, width: Number, height: Number, title: str):
        self.width, self.height = width, height
        self._root = ET.Element(
            "svg",
            {
                "viewBox": f"0 0 {width:g} {height:g}",
                "width": f"{width:g}",
                "height": f"{height:g}",
                "role": "img",
                "class": "chart",
                "aria-label": clean(title),
            },
        )

    def line(self, x1: Number, y1: Number, x2: Number, y2: Number, kind: str) -> None:
        """Draw a straight line."""
        ends = {"x1": x1, "y1": y1, "x2": x2, "y2": y2}
        self._add("line", kind, **ends)

    def path(self, points: Sequence[tuple[Number, Number]], kind: str) -> None:
        """Draw a line through points; none for fewer than two."""
        if len(points) > 1:
            told = " L".join(f"{x:.1f} {y:.1f}" for x, y in points)
            self._root.append(ET.Element("path", {"class": kind, "d": f"M{told}"}))

    def dot(self, x: Number, y: Number, radius: Number, kind: str, told: str = "") -> None:
        """Draw a dot; ``told`` appears where the pointer rests on it."""
        self._tell(self._add("circle", kind, cx=x, cy=y, r=radius), told)

    def diamond(self, x: Number, y: Number, size: Number, kind: str, told: str = "") -> None:
        """Draw a diamond."""
        corners = ((x, y - size), (x + size, y), (x, y + size), (x - size, y))
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in corners)
        shape = ET.SubElement(self._root, "polygon", {"class": kind, "points": points})
        self._tell(shape, told)

    def bar(
        self, x: Number, y: Number, width: Number, height: Number, kind: str, told: str = ""
    ) -> None:
        """Draw a rectangle; lengths below zero count as zero."""
        size = {"width": max(width, 0.0), "height": max(height, 0.0)}
        self._tell(self._add("rect", kind, x=x, y=y, **size), told)

    def text(
        self, x: Number, y: Number, text: str, *, anchor: str = "l", kind: str = "label"
    ) -> None:
        """Write a line of text; ``anchor`` is l, m or r for left, middle or right."""
        element = self._add("text", kind, x=x, y=y)
        element.set("text-anchor", _ANCHORS[anchor])
        element.text = clean(text)

    def turned(self, x: Number, y: Number, text: str, *, kind: str = "label") -> None:
        """Write a line of text upwards, its middle at a point."""
        self.text(x, y, text, anchor="m", kind=kind)
        self._root[-1].set("transform", f"rotate(-90 {x:g} {y:g})")

    def markup(self) -> Markup:
        """Return the picture as an element of a page."""
        return Markup(ET.tostring(self._root, encoding="unicode", short_empty_elements=True))

    def _add(self, tag: str, kind: str, **numbers: Number) -> ET.Element:
        values = {name: f"{value:.2f}".rstrip("0").rstrip(".") for name, value in numbers.items()}
        return ET.SubElement(self._root, tag, {"class": kind, **values})

    def _tell(self, element: ET.Element, told: str) -> None:
        if told:
            ET.SubElement(element, "title").text = clean(told)


def ticks(low: Number, high: Number, most: int = 6) -> list[float]:
    """Return round numbers between two others, the ends included where they are round."""
    if not high > low:
        return [float(low)]
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= raw * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(k * step, 10) for k in range(first, last + 1)]
