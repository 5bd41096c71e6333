"""Axes of charts."""

from __future__ import annotations

from chart_marks import texts
from graspcast.report.axes import axes, keys_below


def test_values_lie_where_the_labels_are() -> None:
    area = axes("t", "x name", "y name", x_range=(0, 10), y_range=(0, 2), size=(400, 300))
    assert area.x(0) == area.left and area.x(10) == area.right
    assert area.y(0) == area.bottom and area.y(2) == area.top
    assert area.x(5) == (area.left + area.right) / 2
    assert area.x(-5) == area.left and area.x(99) == area.right  # never outside
    found = texts(area.drawing.markup())
    assert {"x name", "y name", "0", "10", "2"} <= set(found)


def test_keys_and_own_labels() -> None:
    area = axes("t", "x", "y", x_ticks=[0.5], told=lambda value: f"at {value}", keys=4)
    shapes = ("line", "dot", "diamond", "bar")
    keys_below(area, [(shape, "s0", f"the {shape}") for shape in shapes], from_y=300)
    found = texts(area.drawing.markup())
    assert "at 0.5" in found and {f"the {shape}" for shape in shapes} <= set(found)
    assert area.drawing.height == 300 + 4 * 20
