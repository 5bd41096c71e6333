"""Rotation matrices from files: rounding is kept, deviations are projected and measured."""

from __future__ import annotations

import numpy as np
from scipy.linalg import polar
from scipy.spatial.transform import Rotation

from graspcast.bop.rotations import MAX_ROTATION_DEVIATION, checked_rotations


def test_rounded_rotations_are_not_changed() -> None:
    rounded = Rotation.random(20, random_state=0).as_matrix().astype(np.float32).astype(float)
    checked, distance = checked_rotations(rounded)
    np.testing.assert_array_equal(checked, rounded)
    assert (distance < 1e-6).all()


def test_other_matrices_become_the_nearest_rotation() -> None:
    rng = np.random.default_rng(1)
    noisy = Rotation.random(20, random_state=1).as_matrix() + rng.normal(0, 1e-3, (20, 3, 3))
    checked, distance = checked_rotations(noisy)
    nearest = np.stack([polar(matrix)[0] for matrix in noisy])
    np.testing.assert_allclose(checked, nearest, atol=1e-12)
    np.testing.assert_allclose(distance, np.linalg.norm(noisy - nearest, axis=(1, 2)), atol=1e-12)
    assert (distance < MAX_ROTATION_DEVIATION).all()


def test_reflections_and_scaled_rotations_are_far_from_rotations() -> None:
    reflection, scaled = np.diag([1.0, 1.0, -1.0]), 1.1 * np.eye(3)
    checked, distance = checked_rotations(np.stack([reflection, scaled]))
    np.testing.assert_allclose(np.linalg.det(checked), 1.0)
    np.testing.assert_allclose(distance, [2.0, 0.1 * np.sqrt(3)])
    assert (distance > MAX_ROTATION_DEVIATION).all()
