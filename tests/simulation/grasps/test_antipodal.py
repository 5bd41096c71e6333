from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bricks import brick
from graspcast.simulation.grasps.antipodal import contact_pairs, points_on_faces

HALF = np.array([0.025, 0.045, 0.035])


def test_points_lie_on_the_faces_that_they_are_said_to() -> None:
    thing = brick()
    points, faces = points_on_faces(thing, 500, np.random.default_rng(0))
    corners = thing.vertices[thing.faces[faces]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    apart = np.einsum("ij,ij->i", points - corners[:, 0], normals)
    assert np.allclose(apart, 0.0, atol=1e-12)


def test_lines_of_pairs_lie_in_the_friction_cones_of_both_surfaces() -> None:
    thing = replace(brick(), friction=0.4)
    pairs = contact_pairs(thing, 600, np.random.default_rng(1))
    pairs = pairs.chosen(pairs.slope <= 0.4)
    assert len(pairs.width_m) > 200
    line = (pairs.second - pairs.first) / pairs.width_m[:, None]
    for points in (pairs.first, pairs.second):
        on = np.isclose(np.abs(points), HALF, atol=1e-9)
        assert on.any(axis=1).all(), "the points are on the surface"
        # On the box the line leaves through the face across from where it starts.
        steepest = np.abs(line).max(axis=1)
        assert np.all(np.abs(line)[on] >= 1 / np.hypot(1, 0.4) - 1e-9)
        assert np.all(steepest >= 1 / np.hypot(1, 0.4) - 1e-9)
    assert pairs.width_m.min() == pytest.approx(0.05, abs=1e-6)


def test_slippery_objects_have_fewer_pairs() -> None:
    shares = []
    for friction in (0.1, 0.9):
        pairs = contact_pairs(replace(brick(), friction=friction), 400, np.random.default_rng(2))
        assert pairs.slope.min() < 1e-6, "a third of the rays run along the normal"
        shares.append(float((pairs.slope <= 0.2).mean()))
    assert shares[0] > 0.9 > shares[1]


def test_a_wall_is_found_as_well_as_the_whole_object() -> None:
    import trimesh

    tube = trimesh.creation.annulus(r_min=0.03, r_max=0.034, height=0.1)
    thing = replace(brick(), vertices=np.array(tube.vertices), faces=np.array(tube.faces))
    widths = contact_pairs(thing, 400, np.random.default_rng(0)).width_m
    assert (np.abs(widths - 0.004) < 0.001).sum() > 50
    assert (np.abs(widths - 0.068) < 0.002).sum() > 10
