"""Tolerance maps."""

from __future__ import annotations

import pytest

from chart_marks import marks, texts
from graspcast.report.reach_chart import ReachRow, reach_chart


def test_bars_go_to_both_sides_of_zero() -> None:
    row = ReachRow("x (closing)", (5.0, 4.0, 6.0, 8.0), (10.0, 9.0, 11.0, 20.0))
    svg = reach_chart("t", "mm", [row])
    back, forth, key = marks(svg, "rect", "s2")
    assert key["y"] > back["y"]  # the last one is the key's
    assert back["x"] + back["width"] == pytest.approx(forth["x"], abs=0.05)
    assert forth["width"] == pytest.approx(2 * back["width"], abs=0.05)
    assert len(marks(svg, "line", "whisker")) == 2
    assert {"x (closing)", "error, mm", "-20", "20"} <= set(texts(svg))
    # A grasp that tolerates nothing is drawn too.
    none = ReachRow("x", (0.0,) * 4, (0.0,) * 4)
    assert marks(reach_chart("t", "mm", [none]), "rect", "s2")[0]["width"] == 0
