"""Tolerance maps of grasps, from what ``tolerance --json`` wrote."""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees
from pathlib import Path
from typing import Any

from graspcast.report.content import Figure, Section
from graspcast.report.reach_chart import ReachRow, reach_chart

__all__ = ["tolerance_section"]

_ABOUT = {"shift": ("along", "mm"), "turn": ("about", "degrees")}
_AXES = ("closing", "across", "approach")


def tolerance_section(tolerances: Mapping[Path, Mapping[str, Any]]) -> Section:
    """Return the section of tolerance maps; empty without tolerances."""
    figures = [
        _figure(number, content, kind)
        for number, content in enumerate(tolerances.values())
        for kind in _ABOUT
    ]
    return Section(
        key="tolerances",
        title="How far off a pose may be",
        paragraphs=(
            "In the frame of the grasp: x is the direction in which the fingers close, z the "
            "approach, y across both.",
        )
        if figures
        else (),
        figures=tuple(figures),
    )


def _figure(number: int, content: Mapping[str, Any], kind: str) -> Figure:
    preposition, unit = _ABOUT[kind]
    mine = [reach for reach in content["reaches"] if reach["kind"] == kind]
    rows, data = [], []
    for axis in dict.fromkeys(reach["axis"] for reach in mine):
        sides = {reach["sign"]: reach for reach in mine if reach["axis"] == axis}
        letter = "xyz"[_AXES.index(axis)] if axis in _AXES else "?"
        ends = [_ends(sides[sign], kind) for sign in (-1, 1) if sign in sides]
        if len(ends) == 2:
            rows.append(ReachRow(f"{letter} ({axis})", ends[0], ends[1]))
        data += [(axis, sign, *_ends(reach, kind)) for sign, reach in sides.items()]
    grasp = f"{content['object']} by {content['gripper']}, grasp {content['grasp']}"
    true, scale = content["at_true_pose"], content["scale"]
    caption = (
        f"Until 90 % and 50 % of the trials succeed. At the true pose {true['held']} of "
        f"{true['of']} succeed. All errors at once: 90 % succeed at {scale['value']:.2g} "
        f"[{scale['low']:.2g}, {scale['high']:.2g}] times the stated deviations."
    )
    what = "Shifts" if kind == "shift" else "Turns"
    return Figure(
        key=f"tolerance-{number + 1}-{kind}",
        title=f"{what} that {grasp} tolerates",
        caption=caption,
        svg=reach_chart(f"{what} {preposition} each axis that the grasp tolerates", unit, rows),
        columns=("axis", "sign", f"success_90_{unit}", "low", "high", f"success_50_{unit}"),
        rows=tuple(data),
    )


def _ends(reach: Mapping[str, Any], kind: str) -> tuple[float, float, float, float]:
    """Return 90 % with its interval, and 50 %, in millimetres or degrees."""
    numbers = [float(reach["success_90"][end]) for end in ("value", "low", "high")]
    numbers.append(float(reach["success_50"]["value"]))
    shown = [1e3 * x if kind == "shift" else degrees(x) for x in numbers]
    return shown[0], shown[1], shown[2], shown[3]
