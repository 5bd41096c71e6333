"""Textures made by arithmetic."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from graspcast.rendering.synthetic.textures import _deinterleave, _interleave, bake, random_surface


def sampled(pixels: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Bilinear samples as OpenGL takes them: texel k is centred on (k + 0.5) / side."""
    side = len(pixels)
    at = np.clip(places * side - 0.5, 0, side - 1)
    low = np.minimum(at.astype(int), side - 2)
    share = at - low
    out = np.zeros((len(places), 3))
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - share[:, 0]) * np.abs(1 - dy - share[:, 1])
            out += weight[:, None] * pixels[low[:, 1] + dy, low[:, 0] + dx]
    return out


@given(seed=st.integers(0, 1000), divisions=st.integers(0, 3))
def test_an_atlas_shows_in_each_triangle_what_its_corners_say(seed: int, divisions: int) -> None:
    ball = trimesh.creation.icosphere(divisions)
    rng = np.random.default_rng(seed)
    # Beyond a triangle's long side its colours go on, as far as colours go.
    colours = rng.integers(64, 192, (len(ball.vertices), 3), dtype=np.uint8)
    faces = rng.permutation(ball.faces)
    atlas = bake(ball.vertices, faces, colours)
    weight = rng.dirichlet([1, 1, 1], len(faces))
    places = np.einsum("fk,fkj->fj", weight, atlas.corners)
    expected = np.einsum("fk,fkj->fj", weight, colours[faces].astype(float))
    np.testing.assert_allclose(sampled(atlas.pixels, places), expected, atol=1.0)


def test_neighbours_on_the_object_are_neighbours_in_the_atlas() -> None:
    # Colours that change slowly over the object change slowly over the atlas, so that a block of
    # texels, which is what a mip map's coarser level shows, is about as bright as its parts.
    ball = trimesh.creation.icosphere(4)
    colours = np.rint(255 * (ball.vertices + 1) / 2).astype(np.uint8)
    atlas = bake(ball.vertices, np.random.default_rng(0).permutation(ball.faces), colours)
    used = np.any(atlas.pixels > 0, axis=-1)
    blocks = atlas.pixels.reshape(len(used) // 16, 16, -1, 16, 3).astype(float)
    full = used.reshape(len(used) // 16, 16, -1, 16).all(axis=(1, 3))
    spread = blocks.std(axis=(1, 3))[full]
    assert full.sum() > 50
    assert spread.mean() < 0.25 * colours.astype(float).std(axis=0).mean()


@given(st.lists(st.tuples(st.integers(0, 1023), st.integers(0, 1023)), min_size=1, max_size=50))
def test_morton_codes_are_places(pairs: list[tuple[int, int]]) -> None:
    grid = np.array(pairs)
    x, y = _deinterleave(_interleave(grid))
    np.testing.assert_array_equal(np.stack([x, y], axis=-1), grid)


def test_surfaces_vary_and_follow_from_the_seed() -> None:
    made = [random_surface(np.random.default_rng(k), 64) for k in range(40)]
    again = [random_surface(np.random.default_rng(k), 64) for k in range(40)]
    for one, other in zip(made, again, strict=True):
        np.testing.assert_array_equal(one, other)
    means = np.array([m.mean(axis=(0, 1)) for m in made])
    assert (np.ptp(means, axis=0) > 100).all()
    assert sum(m.astype(float).std() > 15 for m in made) > 10


@pytest.mark.parametrize("faces", [1, 4, 5, 1000])
def test_an_atlas_has_a_cell_for_each_triangle(faces: int) -> None:
    rng = np.random.default_rng(0)
    vertices = rng.random((3 * faces, 3))
    colours = rng.integers(0, 256, (3 * faces, 3), dtype=np.uint8)
    atlas = bake(vertices, np.arange(3 * faces).reshape(-1, 3), colours)
    assert atlas.corners.min() > 0 and atlas.corners.max() < 1
    assert len(np.unique(np.floor(atlas.corners[:, 0] * len(atlas.pixels) / 4), axis=0)) == faces
