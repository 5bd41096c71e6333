"""Overlays: an estimated pose drawn on its image (the paper's Figure 1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.meshes import Mesh
from graspcast.pose.transforms import transform_points
from graspcast.rendering.drawing import GUIDE
from graspcast.rendering.rasterizer import Canvas

__all__ = ["EDGE", "cut_square", "draw_outline", "draw_overlay", "square_around"]

EDGE = (0, 230, 51)
"""Of the estimate's outline, RGB."""
_GREEN, _EDGE, _ALPHA = (0.12, 0.85, 0.30), (0.0, 0.9, 0.2), 0.45
_MARGIN = 1.25
_LEAST_PIXELS = 48.0
_NEAR_M = 0.02


def draw_overlay(
    image: UInt8[ndarray, "h w 3"],
    K: Float[ndarray, "3 3"],
    mesh: Mesh,
    colours: UInt8[ndarray, "v 3"],
    cam_T_est: Float[ndarray, "4 4"],
    cam_T_true: Float[ndarray, "4 4"] | None = None,
    *,
    guides: Sequence[Float[ndarray, "4 4"]] = (),
    size: int = 320,
) -> UInt8[ndarray, "size size 3"]:
    """Draw poses of an object on a square crop of an image: the true one solid, the estimate green.

    Parameters
    ----------
    image, K
        The image and its camera's intrinsics, pixels.
    mesh, colours
        The object's mesh, and the RGB colour of each vertex.
    cam_T_est
        The estimated pose, drawn over everything, with an outline.
    cam_T_true
        The true pose, if it is known.
    guides
        Further poses, which guide grasps, each drawn as an outline alone.
    size
        Side length of the result, pixels.
    """
    poses = [cam_T_est] if cam_T_true is None else [cam_T_est, cam_T_true]
    seen = [transform_points(pose, mesh.vertices) for pose in poses]
    guided = [transform_points(pose, mesh.vertices) for pose in guides]
    left, top, side = square_around(
        np.concatenate([*seen, *guided]), K, image.shape[1], image.shape[0]
    )
    scale = size / side
    # Intrinsics count from the centre of the first pixel, the window from its corner.
    zoomed = np.diag([scale, scale, 1.0]) @ K
    zoomed[:2, 2] = scale * (K[:2, 2] + 0.5 - [left, top]) - 0.5
    picture = cut_square(image, left, top, side, size)
    if cam_T_true is not None:
        canvas = Canvas(zoomed, size, size, background=picture)
        canvas.draw(seen[1], mesh.faces, colours / 255)
        picture = canvas.image()
    canvas = Canvas(zoomed, size, size, background=picture)
    canvas.draw(seen[0], mesh.faces, _GREEN, alpha=_ALPHA)
    pixels = max(1, round(size / 160))
    draw_outline(canvas, seen[0], mesh, _EDGE, pixels)
    if not guided:
        return canvas.image()
    # On another canvas: on this one, what is translucent would cover the outlines.
    canvas = Canvas(zoomed, size, size, background=canvas.image())
    for points in guided:
        draw_outline(canvas, points, mesh, [c / 255 for c in GUIDE], pixels)
    return canvas.image()


def draw_outline(
    canvas: Canvas,
    points: Float[ndarray, "v 3"],
    mesh: Mesh,
    colour: Sequence[float],
    pixels: int,
) -> None:
    """Draw the outline of a mesh, so many pixels wide, around what it covers.

    Parameters
    ----------
    canvas
        Where to draw.
    points
        The vertices in the camera's frame, metres.
    mesh
        Its faces.
    colour
        RGB, 0 to 1.
    pixels
        Width of the outline.
    """
    from scipy.ndimage import binary_dilation

    inside = canvas.silhouette(points, mesh.faces)
    if inside.any():
        around = binary_dilation(inside, iterations=canvas.supersample * pixels)
        canvas.colour[around & ~inside] = colour


def square_around(
    points: Float[ndarray, "n 3"], K: Float[ndarray, "3 3"], width: int, height: int
) -> tuple[float, float, float]:
    """Return left, top and side of a square around the projected points, pixels from the border."""
    points = points[points[:, 2] > _NEAR_M]
    pixels = points @ K.T
    limit = np.array([width, height])
    # Clipped, so that a wrong estimate does not shrink the object to a few pixels.
    at = np.clip(pixels[:, :2] / pixels[:, 2:] + 0.5, 0, limit)
    if not len(at):
        at = np.stack([np.zeros(2), limit])
    low, high = at.min(axis=0), at.max(axis=0)
    side = float(np.clip(_MARGIN * (high - low).max(), _LEAST_PIXELS, max(width, height)))
    corner = (low + high - side) / 2
    inside = np.clip(corner, 0, np.maximum(limit - side, 0))
    # A window larger than the image is centred on it.
    corner = np.where(limit >= side, inside, (limit - side) / 2)
    return float(corner[0]), float(corner[1]), side


def cut_square(
    image: UInt8[ndarray, "h w 3"], left: float, top: float, side: float, size: int
) -> UInt8[ndarray, "size size 3"]:
    """Resample a square of an image; white beyond the image's border."""
    from PIL import Image

    height, width = image.shape[:2]
    pad = int(np.ceil(max(0.0, -left, -top, left + side - width, top + side - height)))
    padded = np.pad(image, ((pad, pad), (pad, pad), (0, 0)), constant_values=255)
    box = (left + pad, top + pad, left + pad + side, top + pad + side)
    return np.asarray(
        Image.fromarray(padded).resize((size, size), Image.Resampling.BICUBIC, box=box)
    )
