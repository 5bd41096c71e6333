"""Outline of an object's projected model in an image, with the image's colours beside it.

The image is cut to the projected object and a margin; where the object would be more than 160
pixels long, the crop is scaled down. So lengths are in pixels of the image for small objects, and
the time that an object takes is bounded for large ones. Colours are CIELAB over 100, in which equal
distances look about equally different.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray

from graspcast.bop.meshes import Mesh
from graspcast.pose.sanity import pose_problems
from graspcast.pose.transforms import transform_points
from graspcast.rendering.rasterizer import Canvas

__all__ = ["REACH", "Outline", "outline_of"]

REACH = 7
"""How far to either side of the outline colours are sampled, pixels of the crop."""

_MARGIN = REACH + 1
_LONGEST = 160.0
_LEAST_POINTS = 12
_NEAR_M = 0.01
_SMOOTHING = 1.0
_NORMAL_SMOOTHING = 2.0
_TO_XYZ = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]], np.float32
) / np.array([[0.9505], [1.0], [1.089]], np.float32)
"""From linear sRGB to XYZ, relative to the white point D65."""


@dataclass(frozen=True, eq=False)
class Outline:
    """Points of an object's outline in an image, with the colours along their normals.

    Attributes
    ----------
    points
        Where the outline is, x and y in pixels of the crop, (m, 2).
    normals
        Its unit normals, away from the object, (m, 2).
    profiles
        Colours of the smoothed image at each point, from ``REACH`` pixels inside the outline to as
        many outside, CIELAB over 100, (m, 2 REACH + 1, 3).
    along, total
        Of the image's colour gradient at each point, the squared length along the normal, and in
        all directions, (m,).
    inside
        Share of the model's vertices that project into the image.
    """

    points: Float[ndarray, "m 2"]
    normals: Float[ndarray, "m 2"]
    profiles: Float[ndarray, "m _ 3"]
    along: Float[ndarray, " m"]
    total: Float[ndarray, " m"]
    inside: float


def outline_of(
    image: UInt8[ndarray, "h w 3"],
    K: Float[ndarray, "3 3"],
    mesh: Mesh,
    cam_T_obj: Float[ndarray, "4 4"],
) -> Outline | str:
    """Find the outline of an object in an image; if there is none, say why.

    Parameters
    ----------
    image, K
        The image and its camera's intrinsics, pixels.
    mesh
        The object's mesh.
    cam_T_obj
        Its pose.
    """
    (problem,) = pose_problems(cam_T_obj[None])
    if problem:
        return f"the pose {problem}"
    if not len(mesh.faces):
        return "the model has no triangles, and so no outline"
    seen = transform_points(cam_T_obj, mesh.vertices)
    window = _window(seen, K, image.shape[1], image.shape[0])
    if window is None:
        return "the object lies outside the image"
    crop, zoomed = _cut(image, K, window)
    mask = Canvas(zoomed, crop.shape[1], crop.shape[0], supersample=1).silhouette(seen, mesh.faces)
    points, normals = _contour(mask)
    steps = np.arange(-REACH, REACH + 1)
    at = points[:, None] + steps[:, None] * normals[:, None]
    limit = np.array([crop.shape[1] - 1, crop.shape[0] - 1])
    known = ((at >= 0) & (at <= limit)).all(axis=(1, 2))
    if (count := int(known.sum())) < _LEAST_POINTS:
        return f"only {count} points of the outline lie in the image, too few to judge"
    points, normals, at = points[known], normals[known], at[known]
    colours = _smoothed(_lab(crop))
    along, total = _gradients(colours, points, normals)
    inside = window.inside
    return Outline(points, normals, _sampled(colours, at), along, total, inside)


@dataclass(frozen=True)
class _Window:
    """Part of an image, in whole pixels, its scale, and the share of the vertices in the image."""

    left: int
    top: int
    right: int
    bottom: int
    scale: float
    inside: float


def _window(
    seen: Float[ndarray, "v 3"], K: Float[ndarray, "3 3"], width: int, height: int
) -> _Window | None:
    """Return the part of the image around an object; None if it lies outside the image."""
    front = seen[seen[:, 2] > _NEAR_M]
    if not len(front):
        return None
    pixels = front @ K.T
    pixels = pixels[:, :2] / pixels[:, 2:]
    limit = np.array([width, height], dtype=np.float64)
    inside = ((pixels >= -0.5) & (pixels < limit - 0.5)).all(axis=1).sum() / len(seen)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    if len(front) < len(seen):  # reaches behind the camera: it may cover anything
        low, high = np.zeros(2), limit - 1
    if (high < -0.5).any() or (low > limit - 0.5).any():
        return None
    # What lies outside the image takes no time.
    low, high = np.maximum(low, -0.5), np.minimum(high, limit - 0.5)
    scale = min(1.0, _LONGEST / max(1.0, float((high - low).max())))
    start = np.clip(np.floor(low - _MARGIN / scale), 0, limit - 1).astype(int)
    stop = np.clip(np.ceil(high + _MARGIN / scale) + 1, start + 1, limit).astype(int)
    (left, top), (right, bottom) = start.tolist(), stop.tolist()
    return _Window(left, top, right, bottom, scale, float(inside))


def _cut(
    image: UInt8[ndarray, "h w 3"], K: Float[ndarray, "3 3"], window: _Window
) -> tuple[UInt8[ndarray, "ch cw 3"], Float[ndarray, "3 3"]]:
    """Return a part of an image at its scale, and the intrinsics of its camera."""
    crop = image[window.top : window.bottom, window.left : window.right]
    whole = np.array([crop.shape[1], crop.shape[0]])
    size = np.maximum(1, np.rint(whole * window.scale)).astype(int)
    if (size != whole).any():
        from PIL import Image

        resized = Image.fromarray(crop).resize(tuple(size.tolist()), Image.Resampling.BOX)
        crop = np.asarray(resized)
    scale = size / whole
    zoomed = np.diag([*scale, 1.0]) @ K
    # Intrinsics count from the centre of the first pixel, the window from its corner.
    zoomed[:2, 2] = scale * (K[:2, 2] + 0.5 - [window.left, window.top]) - 0.5
    return crop, zoomed


def _contour(
    mask: Bool[ndarray, "h w"],
) -> tuple[Float[ndarray, "m 2"], Float[ndarray, "m 2"]]:
    """Return the points of a mask's contour, and its normals.

    Where the crop's border cuts the mask there is no contour: the crop has a margin around the
    object, so such a border is the image's.
    """
    from scipy.ndimage import binary_erosion, gaussian_filter

    v, u = np.nonzero(mask & ~binary_erosion(mask, border_value=1))
    if min(mask.shape) < 2 or not len(u):
        return np.empty((0, 2)), np.empty((0, 2))
    smooth = gaussian_filter(mask.astype(np.float64), _NORMAL_SMOOTHING, mode="nearest")
    down, right = np.gradient(smooth)
    normals = -np.stack([right[v, u], down[v, u]], axis=1)
    length = np.linalg.norm(normals, axis=1)
    good = length > 1e-6  # a thin part has no inside, and so no normal
    normals = normals[good] / length[good, None]
    # The contour is the border of the outermost pixels that are covered.
    return np.stack([u, v], axis=1)[good] + 0.5 * normals, normals


def _lab(crop: UInt8[ndarray, "h w 3"]) -> Float32[ndarray, "3 h w"]:
    """Convert sRGB to CIELAB over 100, the channels first."""
    linear = _LINEAR[crop].astype(np.float32)
    xyz = np.tensordot(_TO_XYZ, linear, axes=(1, 2))
    f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116)
    lightness = 1.16 * f[1] - 0.16
    return np.stack([lightness, 5.0 * (f[0] - f[1]), 2.0 * (f[1] - f[2])]).astype(np.float32)


def _linear() -> Float32[ndarray, " 256"]:
    """Return the linear intensity of each sRGB value."""
    value = np.arange(256) / 255
    out = np.where(value > 0.04045, ((value + 0.055) / 1.055) ** 2.4, value / 12.92)
    return out.astype(np.float32)


_LINEAR = _linear()


def _smoothed(channels: Float32[ndarray, "3 h w"]) -> Float32[ndarray, "3 h w"]:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(channels, (0, _SMOOTHING, _SMOOTHING), mode="nearest"))


def _sampled(
    channels: Float32[ndarray, "c h w"], at: Float[ndarray, "*n 2"]
) -> Float[ndarray, "*n c"]:
    """Interpolate channels at points (x, y), bilinearly."""
    height, width = channels.shape[1:]
    x = np.clip(at[..., 0], 0, width - 1)
    y = np.clip(at[..., 1], 0, height - 1)
    left = np.minimum(x.astype(np.int64), max(width - 2, 0))
    top = np.minimum(y.astype(np.int64), max(height - 2, 0))
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    fx, fy = x - left, y - top
    upper = channels[:, top, left] * (1 - fx) + channels[:, top, right] * fx
    lower = channels[:, bottom, left] * (1 - fx) + channels[:, bottom, right] * fx
    return np.moveaxis(upper * (1 - fy) + lower * fy, 0, -1).astype(np.float64)


def _gradients(
    colours: Float32[ndarray, "3 h w"],
    points: Float[ndarray, "m 2"],
    normals: Float[ndarray, "m 2"],
) -> tuple[Float[ndarray, " m"], Float[ndarray, " m"]]:
    """Return the squared colour gradient at points: along the normals, and in all directions.

    Each channel's squares are added (Di Zenzo's gradient of a colour image).
    """
    x, y = np.eye(2)
    right = _sampled(colours, points + x) - _sampled(colours, points - x)
    down = _sampled(colours, points + y) - _sampled(colours, points - y)
    along = right * normals[:, :1] + down * normals[:, 1:]
    return (along**2).sum(axis=1) / 4, (right**2 + down**2).sum(axis=1) / 4
