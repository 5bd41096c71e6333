"""Procedural textures: atlases of vertex colours, and table surfaces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int, UInt8
from numpy import ndarray

__all__ = ["Atlas", "bake", "random_surface"]

_CELL = 4
"""Side of a triangle's square in an atlas, texels."""


@dataclass(frozen=True, eq=False)
class Atlas:
    """A texture in which each triangle has its own square.

    Attributes
    ----------
    pixels
        RGB, (side, side, 3).
    corners
        Texture coordinates of the triangles' corners, (f, 3, 2), in [0, 1].
    """

    pixels: UInt8[ndarray, "side side 3"]
    corners: Float[ndarray, "f 3 2"]


def bake(
    vertices: Float[ndarray, "v 3"],
    faces: Int[ndarray, "f 3"],
    colours: UInt8[ndarray, "v 3"],
) -> Atlas:
    """Bake vertex colours into a texture, since MuJoCo has no vertex colours.

    Triangles and squares are both ordered along a Morton curve, so that neighbours on the object
    are neighbours in the atlas, and coarser mip-map levels blend neighbouring triangles.
    """
    middle = vertices[faces].mean(axis=1)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    grid = ((middle - low) / (high - low).max() * 1023).astype(np.int64)
    place = np.empty(len(faces), dtype=np.int64)
    place[np.argsort(_interleave(grid), kind="stable")] = np.arange(len(faces))
    across = 1 << int(np.ceil(np.log2(max(len(faces), 1)) / 2))
    column, row = _deinterleave(place)
    # Corners lie half a texel inside of a square; colours are extrapolated beyond the hypotenuse.
    unit = np.arange(_CELL) / (_CELL - 1)
    b, c = np.meshgrid(unit, unit)
    weight = np.stack([1 - b - c, b, c], axis=-1)
    cells = np.einsum("yxk,fkj->fyxj", weight, colours[faces].astype(np.float64))
    pixels = np.zeros((across, _CELL, across, _CELL, 3), dtype=np.uint8)
    pixels[row, :, column] = np.clip(np.rint(cells), 0, 255).astype(np.uint8)
    inside = np.array([[0, 0], [1, 0], [0, 1]]) * (_CELL - 1) + 0.5
    corner = np.stack([column, row], axis=-1)[:, None] * _CELL + inside
    side = across * _CELL
    return Atlas(pixels.reshape(side, side, 3), corner / side)


def _interleave(grid: Int[ndarray, "n k"]) -> Int[ndarray, " n"]:
    """Interleave the bits of the coordinates (Morton code)."""
    axes = grid.shape[1]
    code = np.zeros(len(grid), dtype=np.int64)
    for bit in range(10):
        for axis in range(axes):
            code |= ((grid[:, axis] >> bit) & 1) << (axes * bit + axis)
    return code


def _deinterleave(code: Int[ndarray, " n"]) -> tuple[Int[ndarray, " n"], Int[ndarray, " n"]]:
    x, y = np.zeros_like(code), np.zeros_like(code)
    for bit in range(16):
        x |= ((code >> (2 * bit)) & 1) << bit
        y |= ((code >> (2 * bit + 1)) & 1) << bit
    return x, y


def random_surface(rng: np.random.Generator, side: int = 256) -> UInt8[ndarray, "side side 3"]:
    """Generate a table texture that can be tiled: plain, clouds, wood, tiles, stripes, speckles."""
    first, second = _colour(rng), _colour(rng)
    cloud = _clouds(rng, side)
    y, x = np.mgrid[:side, :side] / side
    kind = rng.choice(["plain", "clouds", "wood", "tiles", "stripes", "speckles"])
    if kind == "plain":
        share = 0.15 * cloud
    elif kind == "clouds":
        share = cloud
    elif kind == "wood":
        share = 0.5 + 0.5 * np.sin(2 * np.pi * (rng.integers(3, 12) * x + 1.5 * cloud))
    elif kind == "tiles":
        count = 2 * rng.integers(1, 6)
        share = (np.floor(count * x) + np.floor(count * y)) % 2 * 0.8 + 0.2 * cloud
    elif kind == "stripes":
        share = (np.sin(2 * np.pi * (rng.integers(2, 16) * x + rng.integers(0, 16) * y)) > 0) + 0.0
    else:
        share = (rng.random((side, side)) < rng.uniform(0.02, 0.3)) * 0.9 + 0.1 * cloud
    pixels = first + share[..., None] * (second - first)
    pixels += rng.normal(0, rng.uniform(0, 8), (side, side, 1))
    return np.clip(np.rint(pixels), 0, 255).astype(np.uint8)


def _colour(rng: np.random.Generator) -> Float[ndarray, " 3"]:
    """Sample a colour; half of them are nearly grey, as real tables are."""
    grey = rng.uniform(25, 235)
    return np.clip(grey + rng.normal(0, 12 if rng.random() < 0.5 else 60, 3), 0, 255)


def _clouds(rng: np.random.Generator, side: int) -> Float[ndarray, "side side"]:
    """Generate periodic noise of several scales, in [0, 1]."""
    frequency = np.fft.fftfreq(side) * side
    radius = np.hypot(*np.meshgrid(frequency, frequency))
    spectrum = np.fft.fft2(rng.normal(size=(side, side)))
    spectrum *= np.maximum(radius, 1.0) ** -rng.uniform(1.0, 2.5)
    noise = np.fft.ifft2(spectrum).real
    noise -= noise.min()
    return noise / noise.max()
