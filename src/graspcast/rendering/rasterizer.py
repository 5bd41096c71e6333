"""A triangle rasterizer in software, with lighting and supersampling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8
from numpy import ndarray

from graspcast.io.compiling import cached_njit

__all__ = ["Canvas", "Lighting", "corner_normals"]

_CREASE = np.cos(np.radians(40.0))


@dataclass(frozen=True, eq=False)
class Lighting:
    """Ambient and directional light.

    Attributes
    ----------
    ambient
        Strength of the ambient light.
    directions
        Unit vectors along which directional light falls, in the camera's frame, (n, 3).
    strengths
        Strength of each directional light, (n,).
    """

    ambient: float
    directions: Float[ndarray, "n 3"]
    strengths: Float[ndarray, " n"]

    def on(self, normals: Float[ndarray, "*batch 3"]) -> Float[ndarray, "*batch"]:
        """Compute the irradiance of surfaces by Lambert's cosine law."""
        cosines = np.maximum(-normals @ self.directions.T, 0.0)
        return np.asarray(self.ambient + cosines @ self.strengths)


HEADLIGHT = Lighting(0.45, np.array([[0.36, 0.48, 0.8]]), np.array([0.6]))
"""Light from above and to the left of the camera."""


class Canvas:
    """An image that is drawn through a pinhole camera.

    Each pixel is the mean of ``supersample`` by ``supersample`` samples. Points are in the
    camera's frame (x right, y down, z forward), metres; colours are 0 to 1.

    Parameters
    ----------
    K
        Intrinsics in pixels; the middle of the first pixel is (0, 0).
    background
        An image, or one colour.
    width, height
        Size of the image, pixels.
    supersample
        Samples per pixel along each side.
    near
        Depth of the near plane, metres.

    Attributes
    ----------
    K, width, height, supersample
        The parameters.
    colour
        RGB of each sample, (h s, w s, 3).
    inverse_depth
        Inverse depth of each sample, zero for the background, (h s, w s).
    """

    def __init__(
        self,
        K: Float[ndarray, "3 3"],
        width: int,
        height: int,
        *,
        background: UInt8[ndarray, "h w 3"] | tuple[float, float, float] = (1.0, 1.0, 1.0),
        supersample: int = 2,
        near: float = 0.01,
    ):
        s = self.supersample = supersample
        self.K, self.width, self.height, self.near = K, width, height, near
        finer = np.array([[s, 0.0, (s - 1) / 2], [0.0, s, (s - 1) / 2], [0.0, 0.0, 1.0]])
        self._K = finer @ K
        self.colour: Float32[ndarray, "hs ws 3"] = np.empty((height * s, width * s, 3), np.float32)
        if isinstance(background, tuple):
            self.colour[:] = background
        else:
            self.colour[:] = (background / np.float32(255)).repeat(s, axis=0).repeat(s, axis=1)
        self.inverse_depth: Float32[ndarray, "hs ws"] = np.zeros(self.colour.shape[:2], np.float32)
        self._layers: list[tuple[ndarray, ndarray, float]] = []

    def draw(
        self,
        vertices: Float[ndarray, "v 3"],
        faces: Int[ndarray, "f 3"],
        colours: Float[ndarray, "v 3"] | tuple[float, float, float],
        *,
        alpha: float = 1.0,
        lighting: Lighting = HEADLIGHT,
        normals: Float[ndarray, "f 3 3"] | None = None,
    ) -> None:
        """Draw a mesh; both sides of its triangles are visible.

        Parameters
        ----------
        vertices, faces
            The mesh.
        colours
            Colour of each vertex, or one for all.
        alpha
            Opacity. If it is below 1, the mesh's nearest surface is blended over the opaque
            surfaces behind it, in any order of drawing.
        lighting
            The light.
        normals
            Unit normals at the corners of each triangle; by default :func:`corner_normals`.
        """
        corners = np.ascontiguousarray(vertices[faces], dtype=np.float64)
        if normals is None:
            normals = corner_normals(vertices, faces)
        away = np.einsum("fi,fi->f", _area_vectors(corners), corners[:, 0]) > 0
        light = lighting.on(np.where(away[:, None, None], -normals, normals))
        base = np.asarray(colours, dtype=np.float64)
        lit = light[..., None] * (base[faces] if base.ndim == 2 else base)
        lit = np.minimum(lit, 1.0).astype(np.float32)
        colour, depth = self.colour, self.inverse_depth
        if alpha < 1.0:
            colour, depth = np.zeros_like(colour), np.zeros_like(depth)
            self._layers.append((colour, depth, alpha))
        _fill(corners, lit, self._K, np.linalg.inv(self._K), 1.0 / self.near, colour, depth)

    def silhouette(
        self, vertices: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"]
    ) -> Bool[ndarray, "hs ws"]:
        """Compute the mask of samples that a mesh covers, without occlusion; nothing is drawn."""
        corners = np.ascontiguousarray(vertices[faces], dtype=np.float64)
        colour, depth = np.zeros_like(self.colour), np.zeros_like(self.inverse_depth)
        lit = np.zeros(corners.shape, np.float32)
        _fill(corners, lit, self._K, np.linalg.inv(self._K), 1.0 / self.near, colour, depth)
        return depth > 0

    def rays(self) -> Float[ndarray, "hs ws 3"]:
        """Compute the viewing ray of each sample, with z = 1."""
        v, u = np.indices(self.inverse_depth.shape, dtype=np.float64)
        return np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(self._K).T

    def image(self) -> UInt8[ndarray, "h w 3"]:
        """Return the image: samples averaged, translucent meshes blended."""
        colour = self.colour
        if self._layers:
            colour = colour.copy()
            depths = np.stack([depth for _, depth, _ in self._layers])
            # Back to front, per sample.
            for rank in np.argsort(depths, axis=0, kind="stable"):
                for number, (layer, depth, alpha) in enumerate(self._layers):
                    seen = (rank == number) & (depth > self.inverse_depth)
                    colour[seen] += np.float32(alpha) * (layer[seen] - colour[seen])
        s = self.supersample
        # Adding slices is much faster than averaging short axes.
        total = np.zeros((self.height, self.width, 3), np.float32)
        for i in range(s * s):
            total += colour[i // s :: s, i % s :: s]
        return np.rint(total * np.float32(255 / s**2)).astype(np.uint8)

    def depth_m(self) -> Float[ndarray, "h w"]:
        """Return the depth of each pixel's nearest opaque sample, metres; infinity for none."""
        s = self.supersample
        nearest = self.inverse_depth.reshape(self.height, s, self.width, s).max(axis=(1, 3))
        with np.errstate(divide="ignore"):
            return 1.0 / nearest.astype(np.float64)


def corner_normals(
    vertices: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"]
) -> Float[ndarray, "f 3 3"]:
    """Compute a unit normal for each corner of each triangle.

    The mean of the normals of the triangles at the vertex, weighted by their angles there; but the
    triangle's own normal if the two differ by more than 40 degrees, so that edges stay sharp.

    References
    ----------
    G. Thürmer and C. A. Wüthrich, *Computing Vertex Normals from Polygonal Facets*, 1998.
    """
    corners = vertices[faces]
    flat = _unit(_area_vectors(corners))
    ahead, back = _unit(np.roll(corners, -1, 1) - corners), _unit(np.roll(corners, 1, 1) - corners)
    angle = np.arccos(np.clip(np.einsum("fki,fki->fk", ahead, back), -1.0, 1.0))
    weighted = (angle[..., None] * flat[:, None]).reshape(-1, 3)
    total = [np.bincount(faces.ravel(), of, minlength=len(vertices)) for of in weighted.T]
    smooth = _unit(np.stack(total, axis=1))[faces]
    near = np.einsum("fki,fi->fk", smooth, flat) > _CREASE
    return np.where(near[..., None], smooth, flat[:, None])


def _unit(vectors: Float[ndarray, "*batch 3"]) -> Float[ndarray, "*batch 3"]:
    """Normalise vectors to length 1; zero vectors stay zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)


def _area_vectors(corners: Float[ndarray, "f 3 3"]) -> Float[ndarray, "f 3"]:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@no_type_check
@cached_njit()
def _fill(corners, colours, K, rays, farthest, colour, depth):
    """Draw triangles into the buffers, with a depth test.

    A ray r = K^-1 (u, v, 1) meets the plane of corners p0, p1, p2 at z r = sum of b_i p_i, so that
    a = [p0 p1 p2]^-1 r has a_i = b_i / z: linear in the pixel, all positive inside the triangle,
    and their sum is the inverse depth. So triangles need no clipping.

    One function of more than 60 lines, since Numba compiles the loops as one.

    References
    ----------
    M. Olano and T. Greer, *Triangle Scan Conversion using 2D Homogeneous Coordinates*, 1997.

    Parameters
    ----------
    corners
        (f, 3, 3), camera frame.
    colours
        Colours of the corners, (f, 3, 3).
    K, rays
        Intrinsics and their inverse.
    farthest
        Inverse depth of the near plane.
    colour, depth
        Buffers of colour, (h, w, 3), and inverse depth, (h, w).
    """
    height, width = depth.shape
    planes = np.empty((3, 3))
    for f in range(len(corners)):
        p = corners[f]
        for i in range(3):
            q, r = p[(i + 1) % 3], p[(i + 2) % 3]
            planes[i, 0] = q[1] * r[2] - q[2] * r[1]
            planes[i, 1] = q[2] * r[0] - q[0] * r[2]
            planes[i, 2] = q[0] * r[1] - q[1] * r[0]
        volume = p[0, 0] * planes[0, 0] + p[0, 1] * planes[0, 1] + p[0, 2] * planes[0, 2]
        if volume == 0.0:
            continue
        planes /= volume
        left, right, top, bottom = width, -1, height, -1
        behind = 0
        for i in range(3):
            z = p[i, 2]
            if z * farthest < 1.0:
                behind += 1
                continue
            # Clipped, since an integer would overflow far beyond the border.
            u = min(max((K[0, 0] * p[i, 0] + K[0, 1] * p[i, 1]) / z + K[0, 2], -1.0), width)
            v = min(max(K[1, 1] * p[i, 1] / z + K[1, 2], -1.0), height)
            left, right = min(left, int(np.ceil(u))), max(right, int(np.floor(u)))
            top, bottom = min(top, int(np.ceil(v))), max(bottom, int(np.floor(v)))
        if behind == 3:
            continue
        if behind:
            left, right, top, bottom = 0, width - 1, 0, height - 1
        left, right = max(left, 0), min(right, width - 1)
        for y in range(max(top, 0), min(bottom, height - 1) + 1):
            for x in range(left, right + 1):
                rx = rays[0, 0] * x + rays[0, 1] * y + rays[0, 2]
                ry = rays[1, 1] * y + rays[1, 2]
                a = planes[0, 0] * rx + planes[0, 1] * ry + planes[0, 2]
                b = planes[1, 0] * rx + planes[1, 1] * ry + planes[1, 2]
                c = planes[2, 0] * rx + planes[2, 1] * ry + planes[2, 2]
                if a < 0.0 or b < 0.0 or c < 0.0:
                    continue
                inverse = a + b + c
                if inverse > depth[y, x] and inverse <= farthest:
                    depth[y, x] = inverse
                    for k in range(3):
                        mixed = a * colours[f, 0, k] + b * colours[f, 1, k] + c * colours[f, 2, k]
                        colour[y, x, k] = mixed / inverse
