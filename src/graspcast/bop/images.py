"""The RGB images of a BOP dataset."""

from __future__ import annotations

import io
import warnings
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from graspcast.errors import FormatError, InputError
from graspcast.io.reading import read_bytes

if TYPE_CHECKING:
    from PIL import Image

__all__ = ["find_images", "read_image"]

ENDINGS = (".jpeg", ".jpg", ".png", ".webp")
_KINDS = {"L": "is grayscale", "1": "is black and white", "P": "has a palette"}


def find_images(directory: str | PathLike[str]) -> dict[tuple[int, int], Path]:
    """Find the RGB images ``SCENE/rgb/IMAGE.png`` (``.jpg``, ``.webp``): (scene_id, im_id) to file.

    Raises
    ------
    InputError
        If there are none, or two files hold the same image.
    """
    directory = Path(directory)
    out: dict[tuple[int, int], Path] = {}
    for path in sorted(directory.glob("*/rgb/*")) if directory.is_dir() else []:
        scene = path.parent.parent.name
        if scene.isdigit() and path.stem.isdigit() and path.suffix.lower() in ENDINGS:
            key = int(scene), int(path.stem)
            if key in out:
                raise InputError(f"{path}: has the same scene and image as {out[key]}; remove one")
            out[key] = path
    if not out:
        raise InputError(
            f"{directory}: no RGB images here; they should be SCENE/rgb/IMAGE, ending in "
            f"{', '.join(ENDINGS)}"
        )
    return out


def read_image(
    path: str | PathLike[str], size: tuple[int, int] | None = None
) -> UInt8[ndarray, "h w 3"]:
    """Read an RGB image.

    Parameters
    ----------
    path
        PNG, JPEG or WebP.
    size
        Width and height that it must have, if given.

    Raises
    ------
    FormatError
        If it cannot be read, is grayscale, has an alpha channel, or another size.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with _open(path) as image:
            if image.mode != "RGB":
                kind = "has an alpha channel" if "A" in image.mode else None
                kind = kind or _KINDS.get(image.mode, f"is of mode {image.mode}")
                raise FormatError(path, f"{kind}, but an estimator needs three channels, RGB")
            if size is not None and image.size != size:
                raise FormatError(
                    path,
                    f"has {image.width} x {image.height} pixels, but camera.json says "
                    f"{size[0]} x {size[1]}, the size for which the intrinsics hold",
                )
            return np.array(image)
    except Image.DecompressionBombError as error:
        raise FormatError(path, f"is too large an image ({error})") from error
    except UnidentifiedImageError as error:
        raise FormatError(path, "is not a PNG, JPEG or WebP image") from error
    except (OSError, SyntaxError, ValueError) as error:  # what Pillow's decoders raise
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise FormatError(path, f"cannot be read ({reason})") from error


def _open(path: str | PathLike[str]) -> Image.Image:
    """Open an image without Pillow's warning of large ones; those twice as large are refused."""
    from PIL import Image

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Image.DecompressionBombWarning)
        return Image.open(io.BytesIO(read_bytes(path)))
