"""The images of a BOP dataset: RGB, or grey where a dataset has no others."""

from __future__ import annotations

import io
import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from graspcast.errors import FormatError, InputError
from graspcast.io.reading import check_regular, read_bytes

if TYPE_CHECKING:
    from PIL import Image

__all__ = ["find_images", "read_image", "read_image_size"]

_log = logging.getLogger(__name__)

ENDINGS = (".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp")
_KINDS = {"L": "is grayscale", "1": "is black and white", "P": "has a palette"}
_ORIENTATION = 0x0112
_TURNED = (5, 6, 7, 8)
"""Values of the EXIF orientation that exchange width and height."""


def find_images(
    directory: str | PathLike[str], folders: Sequence[str] = ("rgb", "gray")
) -> dict[tuple[int, int], Path]:
    """Find the images ``SCENE/rgb/IMAGE.png`` (``.jpg``, ``.tif``, …): (scene_id, im_id) to file.

    Parameters
    ----------
    directory
        The split.
    folders
        Names of the folder with the images; of each scene the first that there is.

    Raises
    ------
    InputError
        If there are none, or two files hold the same image.
    """
    directory = Path(directory)
    out: dict[tuple[int, int], Path] = {}
    for scene in sorted(directory.iterdir()) if directory.is_dir() else []:
        if not scene.name.isdecimal():
            continue
        folder = next((f for f in folders if any(scene.glob(f"{f}/*"))), folders[0])
        for path in sorted(scene.glob(f"{folder}/*")):
            if path.stem.isdecimal() and path.suffix.lower() in ENDINGS:
                key = int(scene.name), int(path.stem)
                if key in out:
                    raise InputError(
                        f"{path}: has the same scene and image as {out[key]}; remove one"
                    )
                out[key] = path
    if not out:
        raise InputError(
            f"{directory}: no RGB images here; they should be SCENE/{folders[0]}/IMAGE, ending in "
            f"{', '.join(ENDINGS)}"
        )
    return out


def read_image(
    path: str | PathLike[str], size: tuple[int, int] | None = None, *, gray: bool = False
) -> UInt8[ndarray, "h w 3"]:
    """Read an RGB image, turned as its EXIF orientation says, as OpenCV and viewers do.

    Parameters
    ----------
    path
        PNG, JPEG, TIFF or WebP.
    size
        Width and height that it must have, if given.
    gray
        Accept a grey image, too: its values are those of all three channels.

    Raises
    ------
    FormatError
        If it cannot be read, is grayscale, has an alpha channel, or another size.
    """
    from PIL import ImageOps

    with _opened(path) as image:
        if image.mode != "RGB" and not (gray and image.mode == "L"):
            kind = "has an alpha channel" if "A" in image.mode else None
            kind = kind or _KINDS.get(image.mode, f"is of mode {image.mode}")
            needed = "eight bits, grey or RGB" if gray else "three channels, RGB"
            raise FormatError(path, f"{kind}, but an estimator needs {needed}")
        if (orientation := _orientation(image)) != 1:
            _log.warning("%s: images are turned as their EXIF says", Path(path).parent)
            ImageOps.exif_transpose(image, in_place=True)
        if size is not None and image.size != size:
            turned = f", turned as its EXIF orientation {orientation} says"
            raise FormatError(
                path,
                f"has {image.width} x {image.height} pixels{turned if orientation != 1 else ''}, "
                f"but should have {size[0]} x {size[1]}",
            )
        pixels = np.array(image)
        return pixels if pixels.ndim == 3 else np.repeat(pixels[..., None], 3, axis=2)


def read_image_size(path: str | PathLike[str]) -> tuple[int, int]:
    """Read an image's width and height, as :func:`read_image` would return it.

    Raises
    ------
    FormatError
        If it cannot be read.
    """
    with _opened(path, whole=False) as image:
        width, height = image.size
        return (height, width) if _orientation(image) in _TURNED else (width, height)


def _orientation(image: Image.Image) -> int:
    """Return the EXIF orientation, 1 (upright) if there is none."""
    value = image.getexif().get(_ORIENTATION, 1)
    return value if value in range(1, 9) else 1


@contextmanager
def _opened(path: str | PathLike[str], *, whole: bool = True) -> Iterator[Image.Image]:
    """Open an image, its head alone or whole; Pillow's errors in the block become FormatErrors."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            # Of large images; those twice as large are refused.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            check_regular(path)
            with Image.open(io.BytesIO(read_bytes(path)) if whole else path) as image:
                yield image
    except Image.DecompressionBombError as error:
        raise FormatError(path, f"is too large an image ({error})") from error
    except UnidentifiedImageError as error:
        raise FormatError(path, "is not a PNG, JPEG, TIFF or WebP image") from error
    except (OSError, SyntaxError, ValueError, TypeError, KeyError) as error:  # Pillow's decoders
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise FormatError(path, f"cannot be read ({reason})") from error
