"""Figure of a grasp's tolerance: how far off the pose may be, in each direction."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

import numpy as np

from graspcast.rendering.drawing import FAINT, GOOD, INK, blank, save_png, write

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw

    from graspcast.simulation.grasps.tolerance import Reach, Tolerance

__all__ = ["save_tolerance_figure"]

_WIDTH, _ROW, _LEFT, _RIGHT = 860, 44, 210, 30
_HALF = (176, 214, 188)
_NICE = (2, 5, 10, 20, 30, 50, 75, 100)
_ABOUT = {"shift": ("along", 1e3, "mm"), "turn": ("about", 180 / np.pi, "°")}


def save_tolerance_figure(path: str | PathLike[str], tolerance: Tolerance) -> None:
    """Draw the reaches of a tolerance as bars to both sides of zero, and write them as PNG.

    Dark is the reach at which 90 % of the trials succeed, with its interval; light that of 50 %.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    panel = 3 * _ROW + 60
    paper, draw = blank(_WIDTH, 2 * panel + 110)
    write(draw, (20, 26), str(tolerance.grasp), 18, INK, "lm")
    told = "dark: 90 % succeed, with its interval; light: 50 %"
    write(draw, (20, 50), told, 13, FAINT, "lm")
    for number, kind in enumerate(_ABOUT):
        mine = [reach for reach in tolerance.reaches if reach.kind == kind]
        _draw_panel(draw, 76 + number * panel, mine)
    low, high = tolerance.scale.low, tolerance.scale.high
    told = (
        f"all at once: 90 % succeed at {tolerance.scale.value:.2g} [{low:.2g}, {high:.2g}] times "
    )
    write(draw, (20, 2 * panel + 90), told + "the covariance's deviations", 13, INK, "lm")
    save_png(path, paper)


def _draw_panel(draw: ImageDraw, top: int, reaches: list[Reach]) -> None:
    preposition, factor, unit = _ABOUT[reaches[0].kind]
    largest = max(reach.half.value for reach in reaches) * factor
    most = next((nice for nice in _NICE if nice >= largest), _NICE[-1])
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    per_unit = (_WIDTH - _RIGHT - _LEFT) / 2 / most

    def x(reach: Reach, size: float) -> float:
        return middle + reach.sign * min(size * factor, most) * per_unit

    for number, reach in enumerate(reaches):
        y = top + (number // 2) * _ROW + 18
        if reach.sign < 0:
            name = f"{preposition} {'xyz'[number // 2]} ({reach.axis})"
            write(draw, (20, y), name, 14, INK, "lm")
        for size, colour in ((reach.half.value, _HALF), (reach.ninety.value, GOOD)):
            ends = sorted((middle, x(reach, size)))
            draw.rectangle((ends[0], y - 9, ends[1], y + 9), fill=colour)
        ends = sorted((x(reach, reach.ninety.low), x(reach, reach.ninety.high)))
        draw.line((ends[0], y, ends[1], y), fill=INK, width=2)
        for end in ends:
            draw.line((end, y - 5, end, y + 5), fill=INK, width=2)
    bottom = top + 3 * _ROW
    draw.line((_LEFT, bottom, _WIDTH - _RIGHT, bottom), fill=FAINT)
    draw.line((middle, top - 4, middle, bottom), fill=FAINT)
    for part in (-1.0, -0.5, 0.0, 0.5, 1.0):
        at = round(middle + part * most * per_unit)
        draw.line((at, bottom, at, bottom + 5), fill=FAINT)
        sign = "+" if part > 0 else ""
        write(draw, (at, bottom + 16), f"{sign}{part * most:g} {unit}", 12, FAINT, "mm")
