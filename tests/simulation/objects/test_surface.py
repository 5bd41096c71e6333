from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from cad_parts import plate, profile, tube
from graspcast.simulation.objects.surface import Surface


def surface(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


BOX = surface(trimesh.creation.box((0.1, 0.06, 0.04)))


@given(st.tuples(*3 * [st.floats(-0.15, 0.15)]))
def test_distance_from_a_box_is_that_of_the_formula(point: tuple[float, ...]) -> None:
    half = np.array([0.05, 0.03, 0.02])
    beyond = np.abs(point) - half
    outside = np.linalg.norm(np.maximum(beyond, 0))
    expected = outside if outside > 0 else -beyond.max()
    assert BOX.distances(np.array([point]))[0] == pytest.approx(expected, abs=1e-7)


@pytest.mark.parametrize("mesh", [plate([(1, 1)]), profile(), tube()])
def test_points_of_the_surface_are_on_it(mesh: trimesh.Trimesh) -> None:
    mine = surface(mesh)
    for points in (mine.by_area, mine.details, np.array(mesh.triangles_center)):
        assert mine.distances(points).max() < 1e-7


def test_centroid_and_moments_are_those_of_many_samples() -> None:
    mine = surface(profile())
    many, _ = trimesh.sample.sample_surface(profile(), 200_000, seed=1)
    np.testing.assert_allclose(mine.centroid, many.mean(axis=0), atol=2e-4)
    np.testing.assert_allclose(mine.moments, np.cov(np.array(many).T), atol=1e-5)


def test_sides_and_extents() -> None:
    box = surface(trimesh.creation.box((0.1, 0.06, 0.04)))
    assert box.outside(np.array([[0.0, 0, 0.03], [0.0, 0, 0.01]])).tolist() == [True, False]
    assert box.diameter_m == pytest.approx(np.linalg.norm([0.1, 0.06, 0.04]))
    assert box.width_m == pytest.approx(0.06)
