"""Conventions of boxes: shares of the image, and pairs of corners, told by all boxes of a file."""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import FormatError

__all__ = ["check_convention"]

_MOST_OF_A_SHARE = 2.0
_MOST = 0.5
_OUTSIDE = 0.1
_MANY = 3


def check_convention(
    boxes: Float[ndarray, "n 4"],
    size: tuple[int, int] | None,
    path: str | PathLike[str],
    sizes: Callable[[], Float[ndarray, "n 2"]] | None = None,
) -> tuple[str, ...]:
    """Raise if all boxes of a file are shares of the image, or corners; return what is odd.

    Amodal boxes may end beyond the image, so that corners are told from width and height only by
    many boxes, all of which fit the image as corners, while most of them do not as they are.

    Parameters
    ----------
    boxes
        Left, top, width, height, as read.
    size
        Width and height of the images, if it is known and one.
    path
        The file, for messages.
    sizes
        Gives width and height of the image of each box, NaN where unknown; asked if boxes do not
        fit the common size, or there is none.

    Raises
    ------
    FormatError
        Naming the first such box.
    """
    if len(boxes) and np.abs(boxes).max() <= _MOST_OF_A_SHARE:
        raise FormatError(
            path,
            f"all boxes are smaller than {_MOST_OF_A_SHARE:g} pixels (the first is "
            f"{_text(boxes[0])}); are they shares of the image? A box is x, y, width, height in "
            "pixels",
        )
    if not len(boxes):
        return ()
    limits = None if size is None else np.full((len(boxes), 2), size, dtype=np.float64)
    if sizes is not None and (limits is None or _odd(boxes, limits)):
        limits = sizes()
    if limits is None:
        return ()
    known = np.isfinite(limits).all(axis=1)
    boxes, limits = boxes[known], limits[known]
    if not len(boxes) or not _odd(boxes, limits):
        return ()
    beyond = _beyond(boxes, limits)
    first = int(np.flatnonzero(beyond)[0])
    width, height = limits[first]
    text = (
        f"{int(beyond.sum())} of {len(boxes)} boxes end beyond the image of {width:g} x "
        f"{height:g} pixels (the first is {_text(boxes[first])}); a box is x, y, width, height in "
        "pixels"
    )
    corners = boxes.reshape(-1, 2, 2)
    as_corners = bool(
        (corners[:, 0] >= -1).all()
        and (corners[:, 1] > corners[:, 0]).all()
        and (corners[:, 1] <= limits + 1).all()
    )
    if as_corners and len(boxes) >= _MANY:
        raise FormatError(path, f"{text}; these are two corners, which all lie within the image")
    return (f"{path}: {text}{'; are they two corners?' if as_corners else ''}",)


def _beyond(boxes: Float[ndarray, "n 4"], limits: Float[ndarray, "n 2"]) -> Bool[ndarray, " n"]:
    """Return which boxes end beyond their image."""
    found: ndarray = (boxes[:, :2] + boxes[:, 2:] > limits).any(axis=1)
    return found


def _odd(boxes: Float[ndarray, "n 4"], limits: Float[ndarray, "n 2"]) -> bool:
    """Return whether most boxes end beyond their images, by much of their area."""
    start, extent = boxes[:, :2], boxes[:, 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = np.minimum(start + extent, limits) - np.maximum(start, 0)
        outside = 1 - np.nan_to_num((inside / extent).clip(0, 1)).prod(axis=1)
    return bool(_beyond(boxes, limits).mean() > _MOST and outside.mean() > _OUTSIDE)


def _text(box: Float[ndarray, "4"]) -> str:
    return f"[{', '.join(f'{value:g}' for value in box)}]"
