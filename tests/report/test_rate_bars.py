"""Bars of rates in bins."""

from __future__ import annotations

import numpy as np
import pytest

from chart_marks import marks, texts
from graspcast.evaluation.bootstrap import Interval
from graspcast.report.rate_bars import Bin, rate_bars


def test_heights_are_rates() -> None:
    bins = [
        Bin("0-2", 10, Interval(1.0, 0.9, 1.0)),
        Bin("2-5", 7, Interval(0.5, np.nan, np.nan)),
        Bin(">5", 0, None),
    ]
    svg = rate_bars("t", "mm", "rate", bins)
    tall, half = marks(svg, "rect", "bar")
    assert half["height"] == pytest.approx(tall["height"] / 2, abs=0.02)
    assert len(marks(svg, "line", "whisker")) == 1
    assert {"0-2", "2-5", ">5", "10", "7"} <= set(texts(svg))
