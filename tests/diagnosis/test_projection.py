"""Projected models and the camera that fits boxes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from graspcast.bop.models import Models
from graspcast.diagnosis.projection import Seen, fit_camera, outline_points, rays_of, spread
from poses import write_models
from sick_files import K, boxes_of, healthy


def test_the_camera_is_found_from_boxes() -> None:
    files = healthy()
    box = boxes_of(files.meshes[1], files.truth[1])
    edges = np.concatenate([box[:, :2], box[:, :2] + box[:, 2:]], axis=1)
    rays = rays_of(files.meshes[1].vertices, files.truth[1])
    seen = Seen(np.ones(len(box)), rays, edges, np.repeat(0.5 * K[None], len(box), axis=0))
    np.testing.assert_allclose(fit_camera(seen).K, K, atol=1e-6)
    assert spread(seen.edges(), seen) > 0.5
    right = Seen(seen.obj_id, rays, edges, np.repeat(K[None], len(box), axis=0))
    assert spread(right.edges(), right) < 1e-9


def test_points_behind_the_camera_have_no_edge() -> None:
    pose = np.eye(4)[None].copy()
    pose[0, 2, 3] = -1
    assert np.isnan(rays_of(np.zeros((1, 3)), pose)).all()


def test_an_object_without_a_mesh_has_no_outline(tmp_path: Path) -> None:
    models = Models(write_models(tmp_path, obj_1={}, obj_2={}))
    (tmp_path / "obj_000002.ply").write_text("no mesh")
    points = outline_points(models, 1)
    assert points is not None and len(points) == 8
    assert outline_points(models, 2) is None
