"""Sheets of pictures with captions: colours, text, and PNG files."""

from __future__ import annotations

from os import PathLike
from typing import TYPE_CHECKING

from graspcast.io.files import atomic_write

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw

__all__ = [
    "BAD",
    "FAINT",
    "GOOD",
    "GUIDE",
    "INK",
    "LOOK",
    "PAPER",
    "blank",
    "save_png",
    "width_of",
    "write",
]

INK, FAINT, GOOD, BAD = (30, 32, 36), (120, 124, 130), (20, 120, 50), (176, 40, 36)
LOOK, GUIDE = (186, 108, 0), (215, 0, 200)
"""Of verdicts to look again, and of poses that guide the grasp beside the estimate."""
PAPER = (255, 255, 255)


def blank(width: int, height: int) -> tuple[Image, ImageDraw]:
    """Create a white image and an object that draws on it."""
    from PIL import Image, ImageDraw

    paper = Image.new("RGB", (width, height), PAPER)
    return paper, ImageDraw.Draw(paper)


def write(
    draw: ImageDraw,
    at: tuple[int, int],
    text: str,
    size: int,
    colour: tuple[int, int, int],
    anchor: str,
) -> None:
    """Draw a line of text; ``anchor`` is Pillow's, for example ``"lm"`` for left and middle."""
    from PIL import ImageFont

    draw.text(at, text, fill=colour, font=ImageFont.load_default(size), anchor=anchor)


def width_of(text: str, size: int) -> float:
    """Measure the width of a line of text of a font size, pixels."""
    from PIL import ImageFont

    return ImageFont.load_default(size).getlength(text)


def save_png(path: str | PathLike[str], image: Image) -> None:
    """Write an image as PNG, atomically.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    with atomic_write(path) as temporary:
        image.save(temporary, format="PNG")
