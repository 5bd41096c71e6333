"""Interval charts."""

from __future__ import annotations

import numpy as np

from chart_marks import marks, texts
from graspcast.evaluation.bootstrap import Interval
from graspcast.report.interval_chart import RateRow, interval_chart


def test_dots_and_intervals() -> None:
    rows = [
        RateRow("d-1", (Interval(0.2, 0.1, 0.3), Interval(0.9, 0.8, 1.0))),
        RateRow("<very-" + "long-" * 20, (Interval(0.5, np.nan, np.nan), None)),
        RateRow("d-3", (Interval(np.nan, np.nan, np.nan), None)),
    ]
    svg = interval_chart("t", "rate", ["always", "verdicts"], rows)
    assert [len(marks(svg, "line", f"s{k}")) for k in (0, 1)] == [1, 1]
    first, second = marks(svg, "circle", "s0"), marks(svg, "circle", "s1")
    assert len(first) == 2 + 1 and len(second) == 1 + 1  # with the keys
    whisker = marks(svg, "line", "s0")[0]
    assert whisker["x1"] < first[0]["cx"] < whisker["x2"] and whisker["y1"] == first[0]["cy"]
    assert second[0]["cx"] > first[0]["cx"]
    assert any("…" in text and text.startswith("<very-") for text in texts(svg))
