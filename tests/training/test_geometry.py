"""Geometry of the trained objects as tensors."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")

from graspcast.rendering.synthetic.tabletop import ColouredMesh  # noqa: E402
from graspcast.training.geometry import Geometry, farthest_points  # noqa: E402
from graspcast.training.networks import KEYPOINTS  # noqa: E402
from graspcast.training.objects import Objects  # noqa: E402
from stored_crops import DIAMETER_M, SIZE, Boxes, boxes  # noqa: E402


def test_sizes_and_symmetries_are_those_of_the_models() -> None:
    geometry = Geometry.of(boxes()).to("cpu")
    np.testing.assert_allclose(geometry.size[0], SIZE, rtol=1e-6)
    np.testing.assert_allclose(geometry.diameter, DIAMETER_M, rtol=1e-6)
    # The first box has no symmetry but the identity, which also fills its place.
    np.testing.assert_allclose(geometry.symmetries[0], np.tile(np.eye(4), (2, 1, 1)))
    np.testing.assert_allclose(geometry.symmetries[1, 1], np.diag([-1, -1, 1, 1]), atol=1e-6)


def test_a_coarse_mesh_has_as_many_keypoints_as_any() -> None:
    import trimesh

    box = trimesh.creation.box(SIZE)
    assert len(box.vertices) < KEYPOINTS
    mesh = ColouredMesh(np.array(box.vertices), np.array(box.faces), np.zeros((8, 3), np.uint8))
    found = Geometry.of(Objects("boxes", {1: mesh}, Boxes()))  # type: ignore[arg-type]
    assert len(np.unique(found.keypoints[0].numpy().round(6), axis=0)) == KEYPOINTS
    assert (np.abs(found.keypoints[0].numpy()) <= SIZE / 2 + 1e-6).all()


def test_farthest_points_are_spread() -> None:
    line = np.column_stack([np.linspace(0, 1, 101), np.zeros(101), np.zeros(101)])
    chosen = farthest_points(line, 3)[:, 0]
    assert sorted(chosen.round(2).tolist()) == [0.0, 0.5, 1.0]
