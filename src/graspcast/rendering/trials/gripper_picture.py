"""Picture of a gripper: the open hand from two sides and on a column, with the axes of its TCP."""

from __future__ import annotations

from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.pose.transforms import invert, transform
from graspcast.rendering.drawing import FAINT, INK, blank, save_png, write
from graspcast.rendering.trials.bodies import rest_joints
from graspcast.rendering.trials.renderer import SceneRenderer, View
from graspcast.simulation.grippers.protocol import Gripper
from graspcast.simulation.trial.gripper_bench import grasp_of_column, standing_column
from graspcast.simulation.trial.gripper_measurement import GripperMeasurement
from graspcast.simulation.trial.recording import State, record_trial
from graspcast.simulation.trial.trial import TrialRunner

__all__ = ["save_gripper_picture"]

_COLOURS = ((205, 40, 40), (40, 150, 40), (40, 70, 210))
_HELD_M = 1.0
_ARROW = 0.6
"""Length of an axis, as a share of the opening."""


def save_gripper_picture(
    path: str | PathLike[str],
    gripper: Gripper,
    measured: GripperMeasurement | None = None,
    *,
    size: int = 480,
) -> None:
    """Draw a gripper as PNG: open, seen along y and along x of its TCP, and closed on a column.

    The axes of the TCP are red, green and blue for x, y and z. A circle marks the measured centre
    of the gap, and a dashed line the measured direction of closing.

    Parameters
    ----------
    path
        Path of the PNG file.
    gripper
        The gripper.
    measured
        What :func:`graspcast.simulation.trial.gripper_conformance.check_gripper` measured.
    size
        Width and height of each of the three pictures, pixels.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    column = standing_column(0.5 * gripper.max_opening_m)
    runner = TrialRunner(column, gripper)
    recording = record_trial(
        runner, np.eye(4), grasp_of_column(gripper, 0.5 * gripper.max_opening_m)
    )
    closed = (recording.of("close") or recording.states)[-1]
    opened = _open_hand(runner, gripper, recording.states[0])
    from PIL import Image

    head, foot = 40, 30
    sheet, draw = blank(3 * size + 16, head + size + foot)
    write(draw, (10, head // 2), f"{gripper.name}: axes of its tool centre point", 18, INK, "lm")
    _legend(draw, sheet.width - 10, head // 2, measured is not None)
    with SceneRenderer(column, gripper, width=size, height=size) as renderer:
        length = _ARROW * gripper.max_opening_m
        tips = _tips(opened.sim_T_base @ gripper.base_T_tcp, 1.15 * length)
        panels = (
            (opened, renderer.hand_from(opened, 90.0, tips), "open, seen along y"),
            (opened, renderer.hand_from(opened, 0.0, tips), "open, seen along x"),
            (closed, renderer.close_up(closed), f"closed on a column: {recording.outcome.reason}"),
        )
        for k, (state, view, caption) in enumerate(panels):
            picture = Image.fromarray(renderer.image(state, view))
            _draw_axes(picture, view, state.sim_T_base @ gripper.base_T_tcp, length, measured)
            sheet.paste(picture, (k * (size + 8), head))
            write(
                draw, (k * (size + 8) + size // 2, head + size + foot // 2), caption, 16, INK, "mm"
            )
    save_png(path, sheet)


def _open_hand(runner: TrialRunner, gripper: Gripper, like: State) -> State:
    """Return the open hand high above the table, its TCP's z downwards and x to the right."""
    sim_T_tcp = transform(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, _HELD_M]))
    away = np.eye(4)
    away[2, 3] = -50.0
    return replace(
        like,
        hand_joints=rest_joints(runner),
        sim_T_obj=away,
        sim_T_base=sim_T_tcp @ invert(gripper.base_T_tcp),
    )


def _draw_axes(
    picture: Any,
    view: View,
    sim_T_tcp: Float[ndarray, "4 4"],
    length: float,
    measured: GripperMeasurement | None,
) -> None:
    from PIL import ImageDraw

    draw = ImageDraw.Draw(picture)
    origin, rotation = sim_T_tcp[:3, 3], sim_T_tcp[:3, :3]

    def at(point: ndarray) -> tuple[float, float]:
        x, y = view.pixels(np.atleast_2d(point), picture.width, picture.height)[0]
        return float(x), float(y)

    if measured is not None:
        gap = origin + rotation @ measured.gap_m
        closing = rotation @ measured.closing
        for share in np.arange(-1.2, 1.2, 0.15):
            ends = (gap + share * length * closing, gap + (share + 0.08) * length * closing)
            draw.line([*map(at, ends)], fill=INK, width=2)
        x, y = at(gap)
        draw.ellipse((x - 8, y - 8, x + 8, y + 8), outline=INK, width=2)
    # The farthest tip first, so that nearer arrows cover it.
    for k in np.argsort(-(rotation.T @ view.axes()[2])):
        tip = at(_tips(sim_T_tcp, length)[k])
        draw.line([at(origin), tip], fill=_COLOURS[k], width=4)
        draw.ellipse((tip[0] - 5, tip[1] - 5, tip[0] + 5, tip[1] + 5), fill=_COLOURS[k])
        write(draw, (round(tip[0]) + 9, round(tip[1]) - 9), "xyz"[k], 18, _COLOURS[k], "lm")


def _tips(sim_T_tcp: Float[ndarray, "4 4"], length: float) -> Float[ndarray, "3 3"]:
    tips: ndarray = sim_T_tcp[:3, 3] + length * sim_T_tcp[:3, :3].T
    return tips


def _legend(draw: Any, right: int, middle: int, measured: bool) -> None:
    text = "x closing   y   z approach"
    if measured:
        text += "   circle and dashes: measured gap and closing"
    write(draw, (right, middle), text, 15, FAINT, "rm")
