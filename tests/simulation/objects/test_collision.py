from __future__ import annotations

import numpy as np
import pytest
import trimesh

from graspcast.bop.meshes import Mesh
from graspcast.simulation.objects.collision import choose_collision, sticks_out
from graspcast.simulation.objects.decomposition import convex_hull
from graspcast.simulation.objects.surface import Surface


@pytest.mark.slow
def test_a_hull_sticks_out_by_the_depth_of_the_hollow() -> None:
    ring = trimesh.creation.torus(0.05, 0.01)
    vertices, faces = np.array(ring.vertices), np.array(ring.faces)
    hull = convex_hull(vertices, 1e-4)
    # The flat top of the hull above the middle, and the nearest point of the ring.
    expected = np.hypot(0.05, 0.01) - 0.01
    assert sticks_out((hull,), Surface(vertices, faces)) == pytest.approx(expected, abs=3e-3)


def test_a_convex_object_is_one_piece() -> None:
    box = trimesh.creation.box((0.1, 0.08, 0.0005))
    mesh = Mesh(np.array(box.vertices), np.array(box.faces))
    shape = choose_collision(mesh, Surface(mesh.vertices, mesh.faces), closed=True)
    assert shape.how.pieces == len(shape.pieces) == 1
    assert shape.sticks_out_m < 1e-6 and str(shape) == "1 piece"
