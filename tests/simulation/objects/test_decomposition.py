from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from graspcast.errors import InputError
from graspcast.simulation.objects import decomposition
from graspcast.simulation.objects.decomposition import (
    Decomposition,
    convex_hull,
    decompose,
)
from graspcast.simulation.objects.types import ConvexPiece

QUICK = Decomposition(pieces=4, threshold=0.2, preprocess_resolution=20)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GRASPCAST_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "convex"


def _angle() -> tuple[np.ndarray, np.ndarray]:
    """An L of two boxes, 10 x 4 x 2 cm: clearly not convex."""
    outline = np.array([[0, 0], [0.1, 0], [0.1, 0.02], [0.02, 0.02], [0.02, 0.1], [0, 0.1]])
    triangles = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    solid = trimesh.creation.extrude_triangulation(outline, np.array(triangles), height=0.04)
    return np.array(solid.vertices), np.array(solid.faces)


def _volume(pieces: tuple[ConvexPiece, ...]) -> float:
    return sum(ConvexHull(p.vertices).volume for p in pieces)


def _same(a: tuple[ConvexPiece, ...], b: tuple[ConvexPiece, ...]) -> bool:
    return len(a) == len(b) and all(
        np.array_equal(p.vertices, q.vertices) and np.array_equal(p.faces, q.faces)
        for p, q in zip(a, b, strict=True)
    )


@pytest.mark.slow
def test_an_angle_becomes_pieces_that_leave_its_notch_open(cache: Path) -> None:
    vertices, faces = _angle()
    pieces = decompose(vertices, faces, QUICK)
    solid = 0.04 * (0.1 * 0.02 + 0.08 * 0.02)
    hull = _volume(decompose(vertices, faces, Decomposition(pieces=1)))
    assert 2 <= len(pieces) <= 4
    assert hull > 1.8 * solid
    assert 0.9 * solid < _volume(pieces) < 1.25 * solid


@pytest.mark.slow
def test_the_cache_is_used_and_gives_the_same(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = _angle()
    first = decompose(vertices, faces, QUICK)
    assert len(list(cache.iterdir())) == 1

    def fail(*args: object) -> None:
        raise AssertionError("computed again")

    monkeypatch.setattr(decomposition, "_run_coacd", fail)
    assert _same(decompose(vertices, faces, QUICK), first)
    with pytest.raises(AssertionError, match="computed again"):
        decompose(vertices * 1.001, faces, QUICK)
    with pytest.raises(AssertionError, match="computed again"):
        decompose(vertices, faces, Decomposition(pieces=4, threshold=0.3))


def test_a_single_hull_is_cached_too(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    one = Decomposition(pieces=1)
    first = decompose(*_angle(), one)

    def fail(*args: object) -> None:
        raise AssertionError("computed again")

    monkeypatch.setattr(decomposition, "convex_hull", fail)
    assert _same(decompose(*_angle(), one), first)


@pytest.mark.slow
def test_the_hull_of_a_fine_ball_takes_few_vertices_and_little_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.03)
    compared = []
    measure = decomposition._farthest

    def counted(corners: np.ndarray, planes: dict[bytes, np.ndarray]) -> dict[bytes, object]:
        compared.append(len(planes))
        return measure(corners, planes)  # type: ignore[return-value]

    monkeypatch.setattr(decomposition, "_farthest", counted)
    piece = convex_hull(np.array(ball.vertices), 3e-4)
    assert 100 < len(piece.vertices) < 500
    # Each new vertex brings a few planes; all are not compared again each time.
    assert sum(compared) < 30 * len(piece.vertices)


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["empty", "cut", "flipped"])
def test_a_damaged_file_is_built_again(
    cache: Path, damage: str, caplog: pytest.LogCaptureFixture
) -> None:
    vertices, faces = _angle()
    first = decompose(vertices, faces, QUICK)
    (path,) = cache.iterdir()
    content = bytearray(path.read_bytes())
    if damage == "flipped":
        content[300] ^= 0xFF
    path.write_bytes({"cut": content[: len(content) // 2], "empty": b""}.get(damage, content))
    # The same again: CoACD is deterministic with its seed.
    assert _same(decompose(vertices, faces, QUICK), first)
    assert "damaged" in caplog.text
    caplog.clear()
    decompose(vertices, faces, QUICK)
    assert not caplog.text


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_costs_time_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GRASPCAST_CACHE", str(tmp_path / "file"))
    assert len(decompose(*_angle(), QUICK)) >= 2
    assert "not cached" in caplog.text


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"pieces": 0}, "at least one piece"),
        ({"threshold": 2.0}, "threshold 2.0"),
        ({"preprocess_resolution": 5}, "preprocess_resolution 5"),
        ({"search_iterations": 1}, "search_iterations 1"),
        ({"hull_tolerance_m": 0.0}, "hull_tolerance_m 0.0"),
    ],
)
def test_parameters_out_of_range(values: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Decomposition(**values)  # type: ignore[arg-type]


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(8, 300), st.floats(1e-4, 1e-2))
def test_a_simplified_hull_lies_inside_and_within_the_tolerance(
    seed: int, n: int, tolerance: float
) -> None:
    points = np.random.default_rng(seed).normal(size=(n, 3)) * [0.02, 0.05, 0.1]
    piece = convex_hull(points, tolerance)
    full = ConvexHull(points)
    assert {tuple(v) for v in piece.vertices} <= {tuple(p) for p in points[full.vertices]}
    equations = ConvexHull(piece.vertices).equations
    assert (points @ equations[:, :3].T + equations[:, 3]).max() <= tolerance + 1e-12
    # Its triangles close and look outwards: they enclose its volume.
    a, b, c = np.moveaxis(piece.vertices[piece.faces], 1, 0)
    enclosed = np.einsum("ij,ij->", a, np.cross(b, c)) / 6
    assert enclosed == pytest.approx(ConvexHull(piece.vertices).volume)


def test_the_hull_of_a_box_is_its_corners() -> None:
    box = trimesh.creation.box(extents=(0.1, 0.2, 0.3)).subdivide().subdivide()
    piece = convex_hull(np.array(box.vertices), 1e-6)
    assert len(piece.vertices) == 8 and len(piece.faces) == 12


def test_points_in_a_plane_have_no_hull() -> None:
    with pytest.raises(InputError, match="span no volume"):
        convex_hull(np.pad(np.random.default_rng(0).random((9, 2)), ((0, 0), (0, 1))), 1e-3)
