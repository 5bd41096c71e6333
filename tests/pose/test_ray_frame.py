"""Poses along the viewing ray: inverses, and what the numbers do not depend on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from graspcast.pose.ray_frame import (
    compressed,
    displaced,
    error_along,
    obj_R_ray,
    ray_frame,
    relative,
)
from graspcast.pose.transforms import rotation_from_vector, transform
from poses import nudged, random_poses

N = 12
seeds = st.integers(0, 10**6)
sizes = st.floats(1e-3, 3.0)


def pairs(seed: int, radians: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    poses = random_poses(N, seed)
    return poses, nudged(poses, seed + 1, metres=0.05, radians=radians)


@given(seeds)
def test_the_frame_looks_along_the_ray(seed: int) -> None:
    poses = random_poses(N, seed)
    frame = ray_frame(poses)
    assert_allclose(frame @ np.swapaxes(frame, 1, 2), np.tile(np.eye(3), (N, 1, 1)), atol=1e-12)
    assert_allclose(np.linalg.det(frame), 1)
    position = poses[:, :3, 3]
    assert_allclose(frame[:, :, 2] * np.linalg.norm(position, axis=1)[:, None], position)
    # x is in the plane of the ray and the camera's x, on the latter's side.
    assert_allclose(frame[:, 0, 1], 0, atol=1e-12)
    assert (frame[:, 0, 0] > 0).all()


@pytest.mark.parametrize("position", [(0, 0, 0), (2, 0, 0), (-3, 0, 0), (0, 0, 1), (0, 1, 0)])
def test_the_frame_where_the_ray_has_no_side_of_its_own(position: tuple[float, ...]) -> None:
    frame = ray_frame(transform(np.eye(3)[None], np.array(position, float)[None]))[0]
    assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)
    if any(position):
        assert_allclose(frame[:, 2], np.array(position) / np.linalg.norm(position))
    else:
        assert_allclose(frame, np.eye(3))


@given(seeds, sizes)
def test_displaced_is_the_inverse_of_relative(seed: int, radians: float) -> None:
    poses, others = pairs(seed, radians)
    assert_allclose(displaced(poses, relative(poses, others)), others, atol=1e-7)
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=(N, 3))
    turn *= rng.uniform(0, 3.1, (N, 1)) / np.linalg.norm(turn, axis=1, keepdims=True)
    by = np.concatenate([rng.normal(scale=0.1, size=(N, 3)), turn], axis=1)
    assert_allclose(relative(poses, displaced(poses, by)), by, atol=1e-6)


def test_displaced_takes_one_pose_and_many_displacements() -> None:
    pose, by = random_poses(1)[0], np.random.default_rng(0).normal(scale=0.1, size=(N, 6))
    many = displaced(pose, by)
    assert_allclose(many, np.stack([displaced(pose, each) for each in by]), atol=1e-12)


@given(seeds, sizes)
def test_the_error_is_that_of_the_poses_and_the_camera_drops_out(seed: int, size: float) -> None:
    true, est = pairs(seed, size)
    distance = np.linalg.norm(est[:, :3, 3], axis=1)
    error = error_along(obj_R_ray(est), distance, relative(est, true))
    assert_allclose(error, np.linalg.inv(true) @ est, atol=1e-7)


@given(seeds)
def test_the_numbers_do_not_know_the_objects_frame(seed: int) -> None:
    poses, others = pairs(seed)
    turn = transform(rotation_from_vector(np.random.default_rng(seed).normal(size=3)), np.zeros(3))
    assert_allclose(relative(poses @ turn, others @ turn), relative(poses, others), atol=1e-9)
    # but another origin is another object's
    moved = transform(np.eye(3), np.array([0.05, 0.02, -0.01]))
    assert np.abs(relative(poses @ moved, others @ moved) - relative(poses, others)).max() > 1e-4


@given(seeds, st.floats(0.1, 10))
def test_the_numbers_do_not_know_the_scale(seed: int, scale: float) -> None:
    poses, others = pairs(seed)
    larger, others_too = poses.copy(), others.copy()
    larger[:, :3, 3] *= scale
    others_too[:, :3, 3] *= scale
    assert_allclose(relative(larger, others_too), relative(poses, others), atol=1e-9)


@given(seeds, st.floats(-0.3, 0.3))
def test_along_the_ray_is_the_third(seed: int, share: float) -> None:
    poses = random_poses(N, seed)
    others = poses.copy()
    others[:, :3, 3] *= 1 + share
    expected = np.zeros((N, 6))
    expected[:, 2] = share
    assert_allclose(relative(poses, others), expected, atol=1e-7)


@given(seeds)
def test_turning_the_camera_about_its_centre_turns_only_about_the_ray(seed: int) -> None:
    poses, others = pairs(seed)
    rng = np.random.default_rng(seed)
    view = transform(rotation_from_vector(rng.normal(scale=0.2, size=3)), np.zeros(3))
    here, there = relative(poses, others), relative(view @ poses, view @ others)
    for part in (slice(0, 3), slice(3, 6)):
        a, b = here[:, part], there[:, part]
        assert_allclose(b[:, 2], a[:, 2], atol=1e-9)
        assert_allclose(np.hypot(b[:, 0], b[:, 1]), np.hypot(a[:, 0], a[:, 1]), atol=1e-9)


@given(seeds)
def test_a_known_frame_changes_nothing(seed: int) -> None:
    poses, others = pairs(seed)
    frame = ray_frame(poses)
    np.testing.assert_array_equal(relative(poses, others, frame), relative(poses, others))
    np.testing.assert_array_equal(obj_R_ray(poses, frame), obj_R_ray(poses))


def test_compressed_numbers_are_in_units_of_typical_ones_and_keep_their_sign() -> None:
    typical = np.array([0.003, 0.003, 0.008, 0.07, 0.07, 0.07])
    assert_allclose(compressed(typical), np.log(2) * np.ones(6))
    assert_allclose(compressed(-3 * typical), -np.log(4) * np.ones(6))
    assert_allclose(compressed(np.zeros((2, 6))), 0)
    each = np.eye(6) * 1e-6  # each number counts for itself, small ones in proportion
    assert_allclose(compressed(each), each / typical, rtol=1e-3)
