"""Drawing of charts."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import pytest

from graspcast.report.svg import Drawing, ticks


def test_text_is_escaped_and_colours_are_classes() -> None:
    drawing = Drawing(100, 50, 'a "title" <b>')
    drawing.text(1, 2, "<script>&", anchor="r")
    drawing.dot(1, 2, 3, "mark s0", "told <i>")
    drawing.path([(0, 0), (1, 1)], "curve s1")
    drawing.path([(0, 0)], "curve s1")
    drawing.bar(0, 0, -1, 2, "bar")
    drawing.diamond(5, 5, 2, "mark")
    drawing.turned(3, 4, "up")
    text = drawing.markup()
    assert "<script" not in text and "&lt;script&gt;&amp;" in text
    root = ET.fromstring(text)
    assert root.get("role") == "img" and root.get("aria-label") == 'a "title" <b>'
    assert len(root.findall("path")) == 1 and root.findtext("circle/title") == "told <i>"
    assert root.find("rect").get("width") == "0"  # type: ignore[union-attr]
    assert all("fill" not in e.attrib and "style" not in e.attrib for e in root.iter())
    assert root.findall("text")[-1].get("transform") == "rotate(-90 3 4)"


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (0, 1, [0, 0.2, 0.4, 0.6, 0.8, 1]),
        (0, 0.7, [0, 0.2, 0.4, 0.6]),
        (-30, 30, [-30, -20, -10, 0, 10, 20, 30]),
        (0.013, 0.057, [0.02, 0.03, 0.04, 0.05]),
        (2, 2, [2]),
    ],
)
def test_ticks_are_round(low: float, high: float, expected: list[float]) -> None:
    assert ticks(low, high) == pytest.approx(expected)
