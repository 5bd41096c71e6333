"""Line charts."""

from __future__ import annotations

from chart_marks import marks, texts
from graspcast.report.line_chart import Curve, Mark, curves_chart, diagonal_chart


def test_curves_marks_and_levels() -> None:
    curves = [Curve("one", ((0.1, 0.5), (1.0, 0.4))), Curve("two", ((0.1, 0.2), (1.0, 0.1)))]
    svg = curves_chart(
        "title",
        "share",
        "fail",
        curves,
        [
            Mark("threshold", 0.5, 0.3, 0),
            Mark("threshold", 0.6, 0.2, 1),
            Mark("certified", 0.7, 0.1, 1, "diamond"),
            Mark("level", None, 0.2),
        ],
        y_most=0.5,
    )
    told = texts(svg)
    assert [t for t in told if t in ("one", "two", "threshold", "certified", "level")] == [
        *("one", "two", "threshold", "certified", "level"),
    ]
    circles = [c for c in marks(svg, "circle", "mark") if c["r"] > 5]
    assert len(circles) == 2 and circles[0]["cx"] < circles[1]["cx"]
    assert circles[0]["cy"] < circles[1]["cy"]  # a lower rate is drawn lower
    level = marks(svg, "line", "level")[0]
    assert level["y1"] == level["y2"] == circles[1]["cy"]


def test_points_beside_the_diagonal() -> None:
    nan = float("nan")
    svg = diagonal_chart("t", "x", "y", [(0.2, 0.2, 0.1, 0.3, 10), (0.8, 0.7, nan, nan, 1000)])
    small, large = marks(svg, "circle", "mark")
    assert small["r"] < large["r"] and len(marks(svg, "line", "whisker")) == 1
    line = marks(svg, "line", "level")[0]
    share = (small["cx"] - line["x1"]) / (line["x2"] - line["x1"])
    assert abs(line["y1"] + share * (line["y2"] - line["y1"]) - small["cy"]) < 0.1
    assert marks(diagonal_chart("t", "x", "y", []), "circle", "mark") == []
