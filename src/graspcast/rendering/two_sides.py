"""One object from two sides: poses as outlines, uncertainty of position as ellipses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.bop.meshes import Mesh
from graspcast.pose.transforms import transform_points
from graspcast.rendering.drawing import FAINT, INK, blank, write
from graspcast.rendering.overlay import cut_square, draw_outline, square_around
from graspcast.rendering.rasterizer import Canvas

if TYPE_CHECKING:
    from PIL.Image import Image

__all__ = ["DrawnPose", "Side", "draw_side", "two_sides"]

_DEVIATIONS = 2.0
_FINER = 3
_FILL = 70


@dataclass(frozen=True, eq=False)
class DrawnPose:
    """A pose to be drawn.

    Attributes
    ----------
    name
        Whose it is, for the legend.
    colour
        RGB, 0 to 255.
    world_T_obj
        The pose, metres.
    covariance
        Of its position, in the world's axes, square metres; None draws no ellipse.
    """

    name: str
    colour: tuple[int, int, int]
    world_T_obj: Float[ndarray, "4 4"]
    covariance: Float[ndarray, "3 3"] | None = None


@dataclass(frozen=True, eq=False)
class Side:
    """An image from one side.

    Attributes
    ----------
    title
        What is written above it.
    image, K
        The image and its camera's intrinsics, pixels.
    world_T_cam
        The camera's pose, metres.
    """

    title: str
    image: UInt8[ndarray, "h w 3"]
    K: Float[ndarray, "3 3"]
    world_T_cam: Float[ndarray, "4 4"]


def two_sides(
    sides: Sequence[Side], mesh: Mesh, poses: Sequence[DrawnPose], note: str = "", size: int = 420
) -> Image:
    """Draw an object from several sides beside each other, with a legend and a note below."""
    from PIL import Image as Pictures

    gap, font, line = 10, 16, 24
    wide = len(sides) * (size + gap) - gap
    sheet, draw = blank(wide, size + (len(poses) + 1 + bool(note)) * line + 12)
    for k, side in enumerate(sides):
        x = k * (size + gap)
        write(draw, (x + size // 2, line // 2), side.title, font, INK, "mm")
        sheet.paste(Pictures.fromarray(draw_side(side, mesh, poses, size)), (x, line))
    for k, pose in enumerate(poses):
        y = size + line + 6 + k * line + line // 2
        draw.rectangle((8, y - 6, 32, y + 6), outline=pose.colour, width=3)
        write(draw, (42, y), pose.name, font, INK, "lm")
    if note:
        y = size + line + 6 + len(poses) * line + line // 2
        write(draw, (8, y), note, 14, FAINT, "lm")
    return sheet


def draw_side(
    side: Side, mesh: Mesh, poses: Sequence[DrawnPose], size: int = 420
) -> UInt8[ndarray, "size size 3"]:
    """Draw the outline of each pose on a square crop of an image, and its position's ellipse.

    An ellipse is the outline of the ellipsoid of two standard deviations, projected to first order.
    """
    from PIL import Image as Pictures
    from PIL import ImageDraw

    cam_T_world = np.linalg.inv(side.world_T_cam)
    seen = [transform_points(cam_T_world @ pose.world_T_obj, mesh.vertices) for pose in poses]
    height, width = side.image.shape[:2]
    left, top, edge = square_around(np.concatenate(seen), side.K, width, height)
    scale = size / edge
    # Intrinsics count from the centre of the first pixel, the square from its corner.
    zoomed = np.diag([scale, scale, 1.0]) @ side.K
    zoomed[:2, 2] = scale * (side.K[:2, 2] + 0.5 - [left, top]) - 0.5
    canvas = Canvas(zoomed, size, size, background=cut_square(side.image, left, top, edge, size))
    for points, pose in zip(seen, poses, strict=True):
        draw_outline(canvas, points, mesh, [c / 255 for c in pose.colour], 2)
    picture = Pictures.fromarray(canvas.image()).resize((_FINER * size, _FINER * size))
    draw = ImageDraw.Draw(picture, "RGBA")
    for pose in poses:
        if pose.covariance is None:
            continue
        at, covariance = _in_image(pose, cam_T_world, zoomed)
        ellipse = _ellipse(at, covariance)
        corners = [(float(u), float(v)) for u, v in _FINER * (ellipse + 0.5)]
        draw.polygon(corners, fill=(*pose.colour, _FILL))
        draw.line([*corners, corners[0]], fill=(255, 255, 255, 255), width=3 * _FINER)
        draw.line([*corners, corners[0]], fill=(*pose.colour, 255), width=2 * _FINER)
    return np.asarray(picture.resize((size, size), Pictures.Resampling.BOX))


def _in_image(
    pose: DrawnPose, cam_T_world: Float[ndarray, "4 4"], K: Float[ndarray, "3 3"]
) -> tuple[Float[ndarray, "2"], Float[ndarray, "2 2"]]:
    """Return a position and its covariance in the image, pixels."""
    x, y, z = (cam_T_world @ pose.world_T_obj)[:3, 3]
    ray = K @ np.array([x, y, z]) / z
    slope = (K[:2] - np.outer(ray[:2], K[2])) / z @ cam_T_world[:3, :3]
    assert pose.covariance is not None
    return ray[:2], slope @ pose.covariance @ slope.T


def _ellipse(
    at: Float[ndarray, "2"], covariance: Float[ndarray, "2 2"]
) -> Float[ndarray, "corners 2"]:
    size, axes = np.linalg.eigh(covariance)
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray(at + _DEVIATIONS * circle * np.sqrt(np.maximum(size, 0)) @ axes.T)
