"""The rasteriser against rays, projections and arithmetic that know nothing of it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from graspcast.rendering.rasterizer import Canvas, Lighting, corner_normals

K = np.array([[70.0, 0.0, 30.5], [0.0, 64.0, 24.0], [0.0, 0.0, 1.0]])
WIDTH, HEIGHT = 64, 48
EVEN = Lighting(1.0, np.empty((0, 3)), np.empty(0))
SEED = st.integers(0, 2**31)


def canvas(supersample: int = 1, **options: object) -> Canvas:
    return Canvas(K, WIDTH, HEIGHT, supersample=supersample, **options)  # type: ignore[arg-type]


def rays() -> np.ndarray:
    """Through the middle of each pixel, row by row, of depth 1."""
    v, u = np.mgrid[:HEIGHT, :WIDTH].reshape(2, -1)
    return np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.size)], axis=-1)


def placed(mesh: trimesh.Trimesh, seed: int = 0, depth: float = 0.5) -> tuple[np.ndarray, ...]:
    turn = Rotation.random(random_state=seed).as_matrix()
    return np.asarray(mesh.vertices) @ turn.T + [0.02, 0.0, depth], np.asarray(mesh.faces)


def first_hit(ray: np.ndarray, triangles: np.ndarray) -> float:
    """Möller & Trumbore, Fast, Minimum Storage Ray/Triangle Intersection, 1997."""
    origin, *corners = np.moveaxis(triangles, 1, 0)
    first, second = (corner - origin for corner in corners)
    p = np.cross(ray, second)
    volume = (first * p).sum(axis=1)
    u = (-origin * p).sum(axis=1) / volume
    q = np.cross(-origin, first)
    v = q @ ray / volume
    far = (second * q).sum(axis=1) / volume
    return float(far[(u >= 0) & (v >= 0) & (u + v <= 1) & (far > 0)].min(initial=np.inf))


def square(depth: float, half: float = 10.0) -> tuple[np.ndarray, np.ndarray]:
    corners = half * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    return corners + [0, 0, depth], np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.box(extents=(0.2, 0.1, 0.15)),
        trimesh.creation.torus(0.12, 0.04, major_sections=24, minor_sections=12),
        trimesh.creation.icosphere(subdivisions=2, radius=0.1),
    ],
    ids=["box", "torus", "sphere"],
)
@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_depth_is_what_rays_meet(mesh: trimesh.Trimesh, seed: int) -> None:
    vertices, faces = placed(mesh, seed)
    drawn = canvas()
    drawn.draw(vertices, faces, (1.0, 0.0, 0.0))
    expected = np.array([first_hit(ray, vertices[faces]) for ray in rays()])
    got = drawn.depth_m().ravel()
    hit = np.isfinite(expected)
    assert hit.sum() > 100
    # A ray through an edge is met by one of them and not by the other.
    assert (np.isfinite(got) != hit).sum() <= 2
    both = hit & np.isfinite(got)
    off = np.abs(got[both] - expected[both])
    assert np.quantile(off, 0.99) < 1e-6
    red = (drawn.image().reshape(-1, 3) != 255).any(axis=1)
    np.testing.assert_array_equal(red, np.isfinite(got))
    np.testing.assert_array_equal(drawn.silhouette(vertices, faces).ravel(), red)


def test_a_finer_sphere_comes_nearer_to_the_true_one() -> None:
    centre, radius = np.array([0.03, -0.02, 0.5]), 0.1
    direction = rays()
    along = direction @ centre / (direction**2).sum(axis=1)
    gap = radius**2 - ((direction * along[:, None] - centre) ** 2).sum(axis=1)
    true = along - np.sqrt(np.maximum(gap, 0) / (direction**2).sum(axis=1))
    inside = gap > 1e-3 * radius**2
    errors = []
    for subdivisions in (2, 3, 4):
        mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
        drawn = canvas()
        drawn.draw(mesh.vertices + centre, np.asarray(mesh.faces), (0.5, 0.5, 0.5))
        depth = drawn.depth_m().ravel()
        seen = inside & np.isfinite(depth)
        errors.append(np.median(np.abs(depth - true)[seen]))
    assert errors[2] < errors[1] / 3 < errors[0] / 9


@given(SEED)
@settings(max_examples=20)
def test_colours_are_mixed_in_perspective(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform([-0.4, -0.3, 0.3], [0.4, 0.3, 1.5], (3, 3))
    colours = rng.uniform(size=(3, 3))
    drawn = canvas()
    drawn.draw(corners, np.array([[0, 1, 2]]), colours, lighting=EVEN)
    seen = np.isfinite(drawn.depth_m())
    points = rays().reshape(HEIGHT, WIDTH, 3)[seen] * drawn.depth_m()[seen][:, None]
    if len(points):
        share = points @ np.linalg.inv(corners)  # of each corner in the point
        np.testing.assert_allclose(share.sum(axis=1), 1.0, atol=1e-5)
        np.testing.assert_allclose(drawn.colour[seen], share @ colours, atol=2e-4)


@given(SEED)
@settings(max_examples=10)
def test_whichever_is_drawn_first_the_nearest_is_seen(seed: int) -> None:
    rng = np.random.default_rng(seed)
    things = [
        (*placed(trimesh.creation.box(extents=rng.uniform(0.05, 0.3, 3)), seed=k, depth=0.5), hue)
        for k, hue in enumerate(((0.9, 0.1, 0.1), (0.1, 0.9, 0.1), (0.1, 0.1, 0.9)))
    ]
    pictures = []
    for order in (things, things[::-1]):
        drawn = canvas(2)
        for number, (vertices, faces, hue) in enumerate(order):
            alpha = 0.4 if hue[2] > 0.5 else 1.0
            drawn.draw(vertices, faces[rng.permutation(len(faces))], hue, alpha=alpha)
            assert number < 3
        pictures.append(drawn.image())
    # Where surfaces meet, one of two triangles at one depth is seen.
    assert (pictures[0] != pictures[1]).any(axis=-1).mean() < 0.01


def test_a_translucent_thing_is_laid_over_once() -> None:
    drawn = canvas(background=(0.2, 0.4, 0.6))
    box = trimesh.creation.box(extents=(20, 20, 0.1))
    drawn.draw(box.vertices + [0, 0, 1], box.faces, (1.0, 0.5, 0.0), alpha=0.3, lighting=EVEN)
    expected = 0.3 * np.array([1.0, 0.5, 0.0]) + 0.7 * np.array([0.2, 0.4, 0.6])
    assert np.abs(drawn.image() - 255 * expected).max() <= 0.51


@pytest.mark.parametrize("far_first", [True, False])
@pytest.mark.parametrize("wall", [None, 0.8, 1.5, 3.0])
def test_translucent_things_are_laid_over_from_far_to_near(
    far_first: bool, wall: float | None
) -> None:
    drawn = canvas()
    layers = [(2.0, 0.25, (0.0, 1.0, 0.0)), (1.0, 0.5, (1.0, 0.0, 0.0))]
    for depth, alpha, hue in layers if far_first else layers[::-1]:
        drawn.draw(*square(depth), hue, alpha=alpha, lighting=EVEN)
    expected = np.ones(3)
    if wall is not None:
        drawn.draw(*square(wall), (0.0, 0.0, 1.0), lighting=EVEN)
        expected = np.array([0.0, 0.0, 1.0])
    for depth, alpha, hue in layers:
        if wall is None or depth < wall:
            expected = alpha * np.array(hue) + (1 - alpha) * expected
    assert np.abs(drawn.image() - 255 * expected).max() <= 0.51
    np.testing.assert_allclose(drawn.depth_m(), np.inf if wall is None else wall, rtol=1e-6)


def test_a_floor_that_goes_on_behind_the_camera() -> None:
    height = 0.3
    floor = np.array([[-50, height, -50], [50, height, -50], [50, height, 50], [-50, height, 50.0]])
    drawn = canvas()
    drawn.draw(floor, np.array([[0, 1, 2], [0, 2, 3]]), (0.0, 0.0, 0.0))
    down = rays()[:, 1].reshape(HEIGHT, WIDTH)
    depth = height / np.where(down > 0, down, np.nan)
    expected = np.where(depth < 50, depth, np.inf)
    np.testing.assert_allclose(drawn.depth_m(), expected, rtol=1e-5)


def test_what_is_behind_or_too_near_is_not_drawn() -> None:
    for depth in (-1.0, -0.05, 0.0, 0.005):
        drawn = canvas()
        drawn.draw(*square(depth), (0.0, 0.0, 0.0))
        assert (drawn.image() == 255).all()
    drawn = canvas(near=0.5)
    drawn.draw(*square(0.49), (0.0, 0.0, 0.0))
    assert (drawn.image() == 255).all()
    drawn.draw(*square(0.51), (0.0, 0.0, 0.0))
    assert (drawn.image() == 0).all()


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0, 90.0, 120.0])
@pytest.mark.parametrize("turned", [False, True])
def test_light_falls_by_the_cosine_on_the_side_that_is_seen(degrees: float, turned: bool) -> None:
    angle = np.radians(degrees)
    falling = np.array([[np.sin(angle), 0.0, np.cos(angle)]])
    vertices, faces = square(1.0)
    drawn = canvas()
    drawn.draw(
        vertices,
        faces[:, ::-1] if turned else faces,
        (0.5, 1.0, 0.0),
        lighting=Lighting(0.1, falling, np.array([0.8])),
    )
    light = 0.1 + 0.8 * max(0.0, np.cos(angle))
    assert np.abs(drawn.image() - 255 * light * np.array([0.5, 1.0, 0.0])).max() <= 0.51


@pytest.mark.parametrize("supersample", [1, 2, 3])
def test_samples_are_in_their_pixels(supersample: int) -> None:
    # The left edge of what is drawn goes through the pixels of column 20.
    left = (19.8 - K[0, 2]) / K[0, 0]
    corners = np.array([[left, -9, 1], [9, -9, 1], [9, 9, 1], [left, 9, 1.0]])
    drawn = canvas(supersample)
    drawn.draw(corners, np.array([[0, 1, 2], [0, 2, 3]]), (0.0, 0.0, 0.0))
    row = drawn.image()[10, :, 0] / 255
    assert (row[:20] == 1).all() and (row[21:] == 0).all()
    assert row[20] == pytest.approx({1: 0.0, 2: 0.5, 3: 1 / 3}[supersample], abs=0.01)


def test_the_background_is_kept_where_nothing_is_drawn() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    drawn = canvas(3, background=noise)
    np.testing.assert_array_equal(drawn.image(), noise)
    ball = trimesh.creation.icosphere(radius=0.05)
    drawn.draw(ball.vertices + [0, 0, 0.5], np.asarray(ball.faces), (0.0, 1.0, 0.0), alpha=0.5)
    inside = drawn.silhouette(ball.vertices + [0, 0, 0.5], np.asarray(ball.faces))
    untouched = ~inside.reshape(HEIGHT, 3, WIDTH, 3).any(axis=(1, 3))
    assert 0 < untouched.sum() < untouched.size
    np.testing.assert_array_equal(drawn.image()[untouched], noise[untouched])


def test_normals_are_sharp_at_edges_and_round_elsewhere() -> None:
    box = trimesh.creation.box(extents=(1.0, 20.0, 3.0))
    flat = corner_normals(np.asarray(box.vertices), np.asarray(box.faces))
    np.testing.assert_allclose(flat, np.repeat(box.face_normals[:, None], 3, axis=1), atol=1e-12)
    ball = trimesh.creation.icosphere(subdivisions=3)
    round_ = corner_normals(np.asarray(ball.vertices), np.asarray(ball.faces))
    np.testing.assert_allclose(round_, ball.vertices[ball.faces], atol=0.02)
