"""Trials as image files: a strip of pictures, or a film."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.io.extras import require
from graspcast.io.files import atomic_write
from graspcast.io.progress import Count
from graspcast.rendering.drawing import BAD, FAINT, GOOD, INK, blank, save_png, write
from graspcast.rendering.trials.renderer import SceneRenderer
from graspcast.simulation.trial.recording import Recording, State
from graspcast.simulation.trial.trial import Outcome

__all__ = ["describe", "save_film", "save_strip", "strip_states", "suffixes", "write_outcome"]

_FPS = {".mp4": 25.0, ".gif": 12.5}
_LINGER_S = 1.0
_LIFTED_M = 0.05


def suffixes() -> tuple[str, ...]:
    """Return the suffixes of the file formats in which a trial can be drawn."""
    return (*_FPS, ".png")


def describe(outcome: Outcome) -> str:
    """Describe an outcome in a few words: its reason, and how far the object moved in the hand.

    An object that the hand does not hold is left behind when it is lifted: by how far is that after
    the full lift, which the pictures do not show where the trial was stopped early. Of a collision,
    where the hand stopped and what it pressed: ``"collided, stopped 40 mm short, pressing the
    object with 62 N"``.
    """
    if outcome.stop:
        return f"{outcome.reason}, {outcome.stop}"
    if np.isnan(outcome.offset_m):
        return outcome.reason
    far = _length(outcome.offset_m)
    if outcome.reason in ("dropped", "missed"):
        return f"{outcome.reason}, object {far} behind after the full lift"
    return f"{outcome.reason}, moved {far} in the hand"


def strip_states(recording: Recording) -> list[tuple[str, State]]:
    """Return the name and state of each picture of a strip, as far as the trial went."""
    approach, close, lift = (recording.of(phase) for phase in ("approach", "close", "lift"))
    out = [("pre-grasp", recording.states[0])]
    if len(approach) > 1:
        collided = recording.outcome.reason == "collided"
        out.append(("stopped" if collided else "at the grasp", approach[-1]))
    if close:
        out.append(("closed", close[-1]))
    if lift:
        risen = [s.sim_T_base[2, 3] - lift[0].sim_T_base[2, 3] for s in lift]
        if risen[-1] > 1.5 * _LIFTED_M:
            first = int(np.argmax(np.array(risen) >= _LIFTED_M))
            out.append((f"hand lifted {_length(risen[first])}", lift[first]))
        out.append((f"end, hand lifted {_length(risen[-1])}", lift[-1]))
    return out


def save_strip(
    path: str | PathLike[str], recording: Recording, renderer: SceneRenderer, title: str
) -> None:
    """Write a PNG of the states of :func:`strip_states` side by side, and the outcome.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    from PIL import Image

    views = dict(zip(map(id, recording.states), renderer.views(recording), strict=True))
    moments = strip_states(recording)
    width, height, line = renderer.width, renderer.height, 26
    sheet, draw = blank(width * len(moments), height + 3 * line)
    for k, (name, state) in enumerate(moments):
        pixels = renderer.image(state, views[id(state)], recording.overlay(state))
        sheet.paste(Image.fromarray(pixels), (k * width, 2 * line))
        write(draw, (k * width + width // 2, 2 * line + height + line // 2), name, 16, FAINT, "mm")
    write(draw, (10, line // 2), title, 17, INK, "lm")
    write_outcome(draw, (10, line + line // 2), recording.outcome, 17, "lm")
    save_png(path, sheet)


def save_film(
    path: str | PathLike[str],
    recording: Recording,
    renderer: SceneRenderer,
    title: str,
    progress: Callable[[float, str], None] | None = None,
) -> None:
    """Write a film in real time, as MP4 or GIF by the suffix of the path.

    The last picture is shown for 1 s longer.

    Raises
    ------
    ExtraMissingError
        If the encoder for MP4 is not installed.
    InputError
        If the file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    fps = _FPS[suffix]
    views = dict(zip(map(id, recording.states), renderer.views(recording), strict=True))
    states = recording.every(1.0 / fps)

    def frames() -> Iterator[UInt8[ndarray, "h w 3"]]:
        for k, state in enumerate(states):
            last = k == len(states) - 1
            pixels = renderer.image(state, views[id(state)], recording.overlay(state))
            frame = _captioned(pixels, title, state.phase, recording.outcome if last else None)
            if progress is not None:
                progress((k + 1) / len(states), Count(k + 1, len(states), "frames"))
            yield from (round(fps * _LINGER_S) if last else 1) * (frame,)

    size = (renderer.width, renderer.height)
    with atomic_write(path) as temporary:
        (_write_mp4 if suffix == ".mp4" else _write_gif)(temporary, frames(), size, fps)


def write_outcome(draw: Any, at: tuple[int, int], outcome: Outcome, size: int, anchor: str) -> None:
    """Write an outcome on a picture, green if it is a success and red if not."""
    write(draw, at, describe(outcome), size, GOOD if outcome.success else BAD, anchor)


def _captioned(
    pixels: UInt8[ndarray, "h w 3"], title: str, phase: str, outcome: Outcome | None
) -> UInt8[ndarray, "h w 3"]:
    from PIL import Image, ImageDraw

    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    write(draw, (10, 16), title, 15, INK, "lm")
    if outcome is None:
        write(draw, (10, 38), phase, 15, FAINT, "lm")
    else:
        write_outcome(draw, (10, 38), outcome, 15, "lm")
    return np.asarray(image)


def _write_gif(
    path: Path, frames: Iterator[UInt8[ndarray, "h w 3"]], size: tuple[int, int], fps: float
) -> None:
    from PIL import Image

    # One palette for all frames, so that the background does not flicker.
    first = Image.fromarray(next(frames)).quantize(128, dither=Image.Dither.NONE)
    rest = (Image.fromarray(f).quantize(palette=first, dither=Image.Dither.NONE) for f in frames)
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
    require("video")
    from imageio_ffmpeg import write_frames

    film = write_frames(
        str(path),
        size,
        fps=fps,
        quality=8,
        macro_block_size=2,
        # The temporary file has no suffix from which the format could be inferred.
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
    if metres >= 0.995:
        return f"{metres:.2f} m"
    return f"{1000 * metres:.0f} mm" if metres >= 0.01 else f"{1000 * metres:.1f} mm"
