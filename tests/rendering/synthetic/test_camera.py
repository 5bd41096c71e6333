"""Random cameras and lights."""

from __future__ import annotations

import numpy as np

from graspcast.rendering.synthetic.camera import random_view

ABOUT = np.array([0.1, -0.2, 0.05])


def test_the_camera_is_above_the_table_and_looks_at_the_point() -> None:
    views = [random_view(np.random.default_rng(seed), ABOUT) for seed in range(200)]
    poses = np.stack([view.sim_T_cam for view in views])
    rotation, position = poses[:, :3, :3], poses[:, :3, 3]
    np.testing.assert_allclose(rotation.swapaxes(1, 2) @ rotation, [np.eye(3)] * 200, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)
    away = position - ABOUT
    distance = np.linalg.norm(away, axis=1)
    assert distance.min() > 0.35 and distance.max() < 1.25
    # z of the camera points to the target, which is within some centimetres of the point.
    along = -(away * rotation[:, :, 2]).sum(axis=1)
    beside = np.sqrt(np.maximum(distance**2 - along**2, 0))
    assert (along > 0).all() and beside.max() < 0.15
    # y of the camera points down, rolled by some degrees.
    assert (rotation[:, 2, 1] < 0).all()
    assert (away[:, 2] > 0).all()


def test_light_falls_from_above_and_the_same_seed_gives_the_same_view() -> None:
    for seed in range(50):
        view = random_view(np.random.default_rng(seed), ABOUT)
        light = view.light
        np.testing.assert_allclose(np.linalg.norm(light.directions, axis=1), 1.0)
        assert (light.directions[:, 2] < 0).all()
        assert 1 <= (light.strengths > 0).all(axis=1).sum() <= 3
        assert (light.ambient > 0).all() and (light.sky >= 0).all() and (light.sky <= 255).all()
        again = random_view(np.random.default_rng(seed), ABOUT)
        np.testing.assert_array_equal(again.sim_T_cam, view.sim_T_cam)
        np.testing.assert_array_equal(again.light.strengths, light.strengths)
