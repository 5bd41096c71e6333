from __future__ import annotations

import numpy as np
import pytest
import trimesh

from graspcast.simulation.objects.simplification import simplified
from graspcast.simulation.objects.surface import Surface


def test_a_large_scan_is_simplified_within_what_is_said(caplog: pytest.LogCaptureFixture) -> None:
    ball = trimesh.creation.icosphere(5, 0.05)
    vertices, faces = np.array(ball.vertices), np.array(ball.faces)
    fewer_vertices, fewer = simplified(vertices, faces, 3000)
    assert 1000 < len(fewer) <= 3000
    (said,) = caplog.messages
    assert said.startswith(
        f"the mesh has 20,480 faces; for collision it is simplified to {len(fewer):,}"
    )
    most = float(said.split("at most ")[1].split(" mm")[0]) / 1000
    apart = Surface(vertices, faces).distances(fewer_vertices)
    assert apart.max() <= most and most < 0.015
    assert set(np.unique(fewer)) <= set(range(len(fewer_vertices)))


def test_a_mesh_that_is_small_enough_stays() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    vertices, faces = np.array(box.vertices), np.array(box.faces)
    same_vertices, same = simplified(vertices, faces)
    assert same_vertices is vertices and same is faces
