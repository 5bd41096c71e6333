"""Bar charts of rates in bins: how often grasps succeed by the size of the error, for example."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from graspcast.evaluation.bootstrap import Interval
from graspcast.report.axes import axes

__all__ = ["Bin", "rate_bars"]


@dataclass(frozen=True)
class Bin:
    """A bin: its label, how many are in it, and the rate among them; None where it is empty."""

    label: str
    count: int
    rate: Interval | None


def rate_bars(title: str, x_label: str, y_label: str, bins: Sequence[Bin]) -> Markup:
    """Draw a bar for each bin, with its interval and, above it, how many are in it."""
    count = len(bins)
    area = axes(
        title,
        x_label,
        y_label,
        x_range=(0.0, float(count)),
        y_range=(0.0, 1.1),
        x_ticks=[k + 0.5 for k in range(count)],
        told=lambda at: bins[int(at)].label,
    )
    for k, found in enumerate(bins):
        middle = area.x(k + 0.5)
        if found.rate is None:
            area.drawing.text(middle, area.bottom - 5, "0", anchor="m", kind="tick")
            continue
        half, top = (area.x(1) - area.x(0)) * 0.36, area.y(found.rate.value)
        told = f"{found.label}: {found.rate} of {found.count}"
        area.drawing.bar(middle - half, top, 2 * half, area.bottom - top, "bar s0", told)
        highest = top
        if found.rate.ends is not None:
            low, high = (area.y(end) for end in found.rate.ends)
            area.drawing.line(middle, low, middle, high, "whisker plain")
            highest = min(top, high)
        area.drawing.text(middle, highest - 5, f"{found.count}", anchor="m", kind="tick")
    return area.drawing.markup()
