"""Trials as files to look at: a strip of pictures, a film, a contact sheet of grasps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from graspcast.errors import ExtraMissingError, InputError
from graspcast.files import atomic_write
from graspcast.grasping.recording import Recording, State
from graspcast.grasping.render import SceneRenderer
from graspcast.grasping.trial import Outcome

__all__ = ["Cell", "describe", "endings", "save_film", "save_sheet", "save_strip", "strip_states"]

Progress = Callable[[float], None]
_FPS = {".mp4": 25.0, ".gif": 12.5}
_LINGER_S = 1.0
_LIFTED_M = 0.05
_INK, _FAINT, _GOOD, _BAD = (30, 32, 36), (120, 124, 130), (20, 120, 50), (176, 40, 36)
_PAPER = (255, 255, 255)


def endings() -> tuple[str, ...]:
    """The endings of files that a trial can be drawn to."""
    return (*_FPS, ".png")


def describe(outcome: Outcome) -> str:
    """An outcome in a few words."""
    if np.isnan(outcome.offset_m):
        return outcome.reason
    return f"{outcome.reason}, moved {_length(outcome.offset_m)}"


def strip_states(recording: Recording) -> list[tuple[str, State]]:
    """What a strip shows: each moment's name and state, as far as the trial came."""
    approach, close, lift = (recording.of(phase) for phase in ("approach", "close", "lift"))
    out = [("pre-grasp", recording.states[0])]
    if len(approach) > 1:
        out.append(("at the grasp", approach[-1]))
    if close:
        out.append(("closed", close[-1]))
    if lift:
        risen = [s.sim_T_base[2, 3] - lift[0].sim_T_base[2, 3] for s in lift]
        if risen[-1] > _LIFTED_M:
            first = int(np.argmax(np.array(risen) >= _LIFTED_M))
            out.append((f"lifted {_length(risen[first])}", lift[first]))
        out.append((f"end, lifted {_length(risen[-1])}", lift[-1]))
    return out


def save_strip(
    path: str | PathLike[str], recording: Recording, renderer: SceneRenderer, title: str
) -> None:
    """A PNG of the moments of :func:`strip_states` side by side, and the outcome.

    Raises:
        ExtraMissingError: if Pillow is not installed.
        InputError: if the file cannot be written.
    """
    image_module, draw_module = _pillow()
    views = dict(zip(map(id, recording.states), renderer.views(recording), strict=True))
    moments = strip_states(recording)
    width, height, line = renderer.width, renderer.height, 30
    sheet = image_module.new("RGB", (width * len(moments), height + 2 * line), _PAPER)
    draw = draw_module.Draw(sheet)
    for k, (name, state) in enumerate(moments):
        estimate = recording.sim_T_est if state.phase != "lift" else None
        pixels = renderer.image(state, views[id(state)], estimate)
        sheet.paste(image_module.fromarray(pixels), (k * width, line))
        _text(draw, (k * width + width // 2, line + height + line // 2), name, 16, _FAINT, "mm")
    _text(draw, (10, line // 2), title, 17, _INK, "lm")
    _outcome_text(draw, (sheet.width - 10, line // 2), recording.outcome, 17, "rm")
    _save_png(path, sheet)


def save_film(
    path: str | PathLike[str],
    recording: Recording,
    renderer: SceneRenderer,
    title: str,
    progress: Progress | None = None,
) -> None:
    """A film in real time, MP4 or GIF by the ending, that lingers on the last picture.

    Raises:
        ExtraMissingError: if Pillow, or for MP4 the encoder, is not installed.
        InputError: if the file cannot be written.
    """
    ending = Path(path).suffix.lower()
    fps = _FPS[ending]
    _pillow()
    views = dict(zip(map(id, recording.states), renderer.views(recording), strict=True))
    states = recording.every(1.0 / fps)

    def frames() -> Iterator[UInt8[ndarray, "h w 3"]]:
        for k, state in enumerate(states):
            last = k == len(states) - 1
            estimate = recording.sim_T_est if state.phase != "lift" else None
            pixels = renderer.image(state, views[id(state)], estimate)
            frame = _captioned(pixels, title, state.phase, recording.outcome if last else None)
            if progress is not None:
                progress((k + 1) / len(states))
            yield from (round(fps * _LINGER_S) if last else 1) * (frame,)

    size = (renderer.width, renderer.height)
    with atomic_write(path) as temporary:
        (_write_mp4 if ending == ".mp4" else _write_gif)(temporary, frames(), size, fps)


@dataclass(frozen=True, eq=False)
class Cell:
    """One field of a contact sheet.

    Attributes:
        pixels: The picture, or None for an empty field.
        note: What is written below it; in an empty field, why it is empty.
        outcome: The outcome of the trial that it shows, if any.
    """

    pixels: UInt8[ndarray, "h w 3"] | None
    note: str
    outcome: Outcome | None = None


def save_sheet(
    path: str | PathLike[str],
    objects: Sequence[tuple[str, str]],
    grippers: Sequence[str],
    cells: dict[tuple[str, str], Cell],
    *,
    size: int,
    columns: int = 5,
) -> None:
    """A PNG with a field for each object and gripper, ``columns`` objects side by side.

    Args:
        path: Where to.
        objects: Name and label of each object, in order.
        grippers: Names; their fields of one object are below one another.
        cells: By name of object and gripper.
        size: Of a field's picture, pixels.
        columns: Objects in a row.

    Raises:
        ExtraMissingError: if Pillow is not installed.
        InputError: if the file cannot be written.
    """
    image_module, draw_module = _pillow()
    columns = min(columns, len(objects))
    bands = -(-len(objects) // columns)
    head, foot, gap, side = 34, 26, 22, 40
    band = head + len(grippers) * (size + foot) + gap
    sheet = image_module.new("RGB", (side + columns * (size + 8), bands * band), _PAPER)
    draw = draw_module.Draw(sheet)
    for k, (name, label) in enumerate(objects):
        x, y = side + (k % columns) * (size + 8), (k // columns) * band
        _text(draw, (x + size // 2, y + head // 2), f"{label}  ({name})", 18, _INK, "mm")
        for row, gripper in enumerate(grippers):
            top = y + head + row * (size + foot)
            cell = cells[name, gripper]
            if k % columns == 0:
                _sideways(sheet, (side // 2, top + size // 2), gripper)
            if cell.pixels is None:
                draw.rectangle((x, top, x + size - 1, top + size - 1), outline=(225, 226, 228))
                _text(draw, (x + size // 2, top + size // 2), cell.note, 15, _FAINT, "mm")
                continue
            sheet.paste(image_module.fromarray(cell.pixels), (x, top))
            at = (x + size // 2, top + size + foot // 2 - 2)
            if cell.outcome is not None:
                _outcome_text(draw, at, cell.outcome, 15, "mm")
            else:
                _text(draw, at, cell.note, 15, _FAINT, "mm")
    _save_png(path, sheet)


def _pillow() -> tuple[Any, Any]:
    try:
        from PIL import Image, ImageDraw
    except ImportError as error:
        raise ExtraMissingError("pillow", "render") from error
    return Image, ImageDraw


def _text(
    draw: Any, at: tuple[int, int], text: str, size: int, colour: tuple[int, ...], anchor: str
) -> None:
    from PIL import ImageFont

    draw.text(at, text, fill=colour, font=ImageFont.load_default(size), anchor=anchor)


def _outcome_text(
    draw: Any, at: tuple[int, int], outcome: Outcome, size: int, anchor: str
) -> None:
    _text(draw, at, describe(outcome), size, _GOOD if outcome.success else _BAD, anchor)


def _sideways(sheet: Any, middle: tuple[int, int], text: str) -> None:
    image_module, draw_module = _pillow()
    label = image_module.new("RGB", (240, 28), _PAPER)
    _text(draw_module.Draw(label), (120, 14), text, 18, _INK, "mm")
    turned = label.rotate(90, expand=True)
    sheet.paste(turned, (middle[0] - turned.width // 2, middle[1] - turned.height // 2))


def _captioned(
    pixels: UInt8[ndarray, "h w 3"], title: str, phase: str, outcome: Outcome | None
) -> UInt8[ndarray, "h w 3"]:
    image_module, draw_module = _pillow()
    image = image_module.fromarray(pixels)
    draw = draw_module.Draw(image)
    _text(draw, (10, 16), title, 15, _INK, "lm")
    if outcome is None:
        _text(draw, (image.width - 10, 16), phase, 15, _FAINT, "rm")
    else:
        _outcome_text(draw, (image.width - 10, 16), outcome, 15, "rm")
    return np.asarray(image)


def _save_png(path: str | PathLike[str], image: Any) -> None:
    with atomic_write(path) as temporary:
        image.save(temporary, format="PNG", optimize=True)


def _write_gif(
    path: Path, frames: Iterator[UInt8[ndarray, "h w 3"]], size: tuple[int, int], fps: float
) -> None:
    image_module, _ = _pillow()
    # One palette for all frames, so that a still background stays still.
    first = image_module.fromarray(next(frames)).quantize(128, dither=image_module.Dither.NONE)
    rest = (
        image_module.fromarray(f).quantize(palette=first, dither=image_module.Dither.NONE)
        for f in frames
    )
    first.save(
        path,
        format="GIF",
        save_all=True,
        append_images=rest,
        duration=round(1000 / fps),
        loop=0,
    )


def _write_mp4(
    path: Path, frames: Iterator[UInt8[ndarray, "h w 3"]], size: tuple[int, int], fps: float
) -> None:
    try:
        from imageio_ffmpeg import write_frames
    except ImportError as error:
        raise ExtraMissingError("imageio-ffmpeg", "render") from error
    film = write_frames(
        str(path),
        size,
        fps=fps,
        quality=8,
        macro_block_size=2,
        # The temporary file's name says nothing of its format.
        output_params=["-f", "mp4", "-movflags", "+faststart"],
    )
    film.send(None)
    try:
        for frame in frames:
            film.send(np.ascontiguousarray(frame))
    except OSError as error:
        raise InputError(f"the encoder stopped ({str(error).splitlines()[0]})") from error
    finally:
        film.close()


def _length(metres: float) -> str:
    return f"{metres:.2f} m" if metres >= 0.995 else f"{1000 * metres:.3g} mm"
