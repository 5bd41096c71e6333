"""Group axioms, and agreement with SciPy's independent implementation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy import ndarray
from numpy.testing import assert_allclose
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from graspcast.pose import transforms as g
from poses import random_poses

SMALL = st.floats(-3, 3, allow_subnormal=False)
VECTORS = arrays(np.float64, (4, 3), elements=SMALL)


def rotations(n: int = 50) -> ndarray:
    """Random ones, and those where formulas break: identity, tiny and half turns."""
    special = [[0, 0, 0], [1e-9, 0, 0], [0, -1e-7, 1e-8], [np.pi, 0, 0], [0, np.pi, 0]]
    special += [[0, 0, np.pi], [0, 0, np.pi - 1e-9], [2.2, -2.2, 0.1], [0, np.pi / 2, 0]]
    vectors = np.concatenate([special, np.random.default_rng(0).normal(size=(n, 3))])
    return Rotation.from_rotvec(vectors).as_matrix()


def test_group_axioms() -> None:
    a, b, c = random_poses(20, 1), random_poses(20, 2), random_poses(20, 3)
    identity = np.broadcast_to(np.eye(4), a.shape)
    assert_allclose(g.compose(g.compose(a, b), c), g.compose(a, g.compose(b, c)), atol=1e-12)
    assert_allclose(g.compose(a, g.invert(a)), identity, atol=1e-12)
    assert_allclose(g.compose(g.invert(a), a), identity, atol=1e-12)
    assert_allclose(g.compose(a, identity), a, atol=0)
    assert_allclose(g.invert(g.compose(a, b)), g.compose(g.invert(b), g.invert(a)), atol=1e-12)


def test_points_move_as_homogeneous_coordinates() -> None:
    a = random_poses(5)
    points = np.random.default_rng(0).normal(size=(7, 3))
    homogeneous = np.c_[points, np.ones(7)]
    expected = np.einsum("nij,vj->nvi", a, homogeneous)[..., :3]
    assert_allclose(g.transform_points(a, points), expected, atol=1e-12)


def test_rotation_vector_and_angle_agree_with_scipy() -> None:
    r = rotations()
    oracle = Rotation.from_matrix(r)
    assert_allclose(g.rotation_angle(r), oracle.magnitude(), atol=1e-9)
    mine = g.rotation_vector(r)
    assert_allclose(Rotation.from_rotvec(mine).as_matrix(), r, atol=1e-9)
    assert_allclose(np.linalg.norm(mine, axis=-1), oracle.magnitude(), atol=1e-9)


def test_quaternions_agree_with_scipy_up_to_sign() -> None:
    r = rotations()
    oracle = np.roll(Rotation.from_matrix(r).as_quat(), 1, axis=-1)
    mine = g.quaternion(r)
    assert (mine[:, 0] >= 0).all()
    assert_allclose(np.abs(np.sum(mine * oracle, axis=-1)), 1, atol=1e-12)
    assert_allclose(g.rotation_from_quaternion(mine * 3.0), r, atol=1e-12)


@given(VECTORS)
def test_exponential_of_rotation_vectors(vectors: ndarray) -> None:
    expected = Rotation.from_rotvec(vectors).as_matrix()
    assert_allclose(g.rotation_from_vector(vectors), expected, atol=1e-12)


@given(arrays(np.float64, (3, 6), elements=st.floats(-1.5, 1.5, allow_subnormal=False)))
def test_exp_is_the_matrix_exponential_and_log_undoes_it(twists: ndarray) -> None:
    poses = g.exp(twists)
    for twist, pose in zip(twists, poses, strict=True):
        generator = np.zeros((4, 4))
        x, y, z = twist[3:]
        generator[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        generator[:3, 3] = twist[:3]
        assert_allclose(pose, expm(generator), atol=1e-9)
    assert_allclose(g.log(poses), twists, atol=1e-7)


def test_euler_angles_agree_with_scipy_and_rebuild_the_rotation_at_the_singularity() -> None:
    r = Rotation.random(50, random_state=0)
    oracle = r.as_euler("ZYX")[:, ::-1]
    assert_allclose(g.euler_zyx(r.as_matrix()), oracle, atol=1e-10)
    upright = Rotation.from_euler("ZYX", [[0.3, np.pi / 2, 0.1], [0.2, -np.pi / 2, -1]])
    rebuilt = Rotation.from_euler("ZYX", g.euler_zyx(upright.as_matrix())[:, ::-1])
    assert_allclose(rebuilt.as_matrix(), upright.as_matrix(), atol=1e-7)


def test_projection_is_a_rotation_and_leaves_rotations_alone() -> None:
    r = rotations()
    assert_allclose(g.project_to_rotation(r), r, atol=1e-12)
    noisy = r + np.random.default_rng(0).normal(scale=0.05, size=r.shape)
    nearest = g.project_to_rotation(noisy)
    assert_allclose(
        nearest @ np.swapaxes(nearest, 1, 2), np.broadcast_to(np.eye(3), r.shape), atol=1e-12
    )
    assert_allclose(np.linalg.det(nearest), 1, atol=1e-12)
    # No other rotation is nearer.
    turned = nearest @ Rotation.from_rotvec([1e-3, -1e-3, 2e-3]).as_matrix()
    assert (
        np.linalg.norm(noisy - nearest, axis=(1, 2)) <= np.linalg.norm(noisy - turned, axis=(1, 2))
    ).all()


def test_a_mirror_is_projected_to_a_rotation() -> None:
    mirror = np.diag([1.0, 1.0, -1.0])[None]
    assert np.linalg.det(g.project_to_rotation(mirror))[0] == pytest.approx(1)


def test_identity_is_told_from_almost_identity() -> None:
    almost = np.eye(4)
    almost[0, 3] = 1e-300
    assert g.is_identity(np.stack([np.eye(4), almost])).tolist() == [True, False]


def test_batches_may_have_any_leading_shape() -> None:
    a = random_poses(6).reshape(2, 3, 4, 4)
    assert g.invert(a).shape == (2, 3, 4, 4)
    assert g.log(a).shape == (2, 3, 6)
    assert g.rotation_angle(a[0, 0, :3, :3]).shape == ()


def test_one_translation_serves_many_rotations_and_many_translations_one_rotation() -> None:
    many = random_poses(4)
    R, t = many[:, :3, :3], many[:, :3, 3]
    assert_allclose(g.transform(R, t[0])[:, :3, 3], np.tile(t[0], (4, 1)))
    together = g.transform(R[0], t)
    assert together.shape == (4, 4, 4)
    assert_allclose(together[2], g.transform(R[0], t[2]))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-6, 2e-6, 0.9e-4, 1.1e-4, 1e-3, 3.0])
def test_exponential_and_logarithm_near_the_identity(angle: float) -> None:
    """Long translations show what the Jacobian's terms of small angles are."""
    for axis in np.eye(3):
        twist = np.concatenate([[300.0, -500.0, 700.0], angle * axis])
        generator = np.zeros((4, 4))
        generator[:3, :3] = g.skew(twist[3:])
        generator[:3, 3] = twist[:3]
        pose = g.exp(twist)
        # Below 1e-4 rad the terms of the series are cut off at the fourth power.
        assert_allclose(pose, expm(generator), rtol=0, atol=1e-9)
        assert_allclose(g.log(pose), twist, rtol=0, atol=1e-6)
        assert_allclose(g.rotation_vector(pose[:3, :3]), twist[3:], rtol=1e-9, atol=1e-15)


def test_half_turns_have_quaternions_too() -> None:
    for axis in np.vstack([np.eye(3), [[0.6, 0.8, 0], [0, 0.6, -0.8], [2 / 3, -1 / 3, 2 / 3]]]):
        r = 2 * np.outer(axis, axis) - np.eye(3)
        q = g.quaternion(r)
        assert_allclose(np.abs(q), np.abs([0, *axis]), atol=1e-12)
        assert_allclose(g.rotation_from_quaternion(q), r, atol=1e-12)
        assert g.rotation_angle(r) == pytest.approx(np.pi)


@pytest.mark.parametrize("leading", range(4))
def test_quaternions_whichever_component_leads(leading: int) -> None:
    q = np.random.default_rng(leading).uniform(-1, 1, (50, 4))
    q[:, leading] = np.random.default_rng(9).choice([-3.0, 3.0], 50)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    found = g.quaternion(g.rotation_from_quaternion(q))
    assert_allclose(found, np.where(q[:, :1] < 0, -q, q), atol=1e-12)


def test_one_rotation_serves_many_translations_and_the_other_way_round() -> None:
    r, t = rotations()[:3], np.arange(9.0).reshape(3, 3)
    one = g.transform(r[0], t)
    assert_allclose(one[:, :3, :3], np.tile(r[0], (3, 1, 1)))
    assert_allclose(one[:, :3, 3], t)
    assert_allclose(one[:, 3], np.tile([0, 0, 0, 1.0], (3, 1)))
    assert_allclose(g.transform(r, t[0])[:, :3, 3], np.tile(t[0], (3, 1)))
    grid = g.transform(r[:, None], t[None, :2])
    assert grid.shape == (3, 2, 4, 4)
    assert_allclose(grid[2, 1], g.transform(r[2], t[1]))


def test_the_matrix_of_a_cross_product() -> None:
    v, w = np.random.default_rng(0).normal(size=(2, 5, 3))
    assert_allclose(np.einsum("nij,nj->ni", g.skew(v), w), np.cross(v, w), atol=1e-12)


def test_composing_is_multiplying() -> None:
    a, b, c = random_poses(3)
    assert_allclose(g.compose(a, b, c), a @ b @ c)
    assert_allclose(g.compose(a), a)


def test_euler_angles_just_off_the_singularity_are_not_taken_for_it() -> None:
    for off in (1e-4, 2e-6):
        r = Rotation.from_euler("ZYX", [[0.3, np.pi / 2 - off, 0.1]]).as_matrix()
        assert_allclose(g.euler_zyx(r), [[0.1, np.pi / 2 - off, 0.3]], atol=1e-6)


def test_no_rotation_is_nearer_to_a_mirror_than_its_projection() -> None:
    """The axis of the smallest singular value is turned over; SciPy solves the same problem."""
    rng = np.random.default_rng(2)
    left, right = (Rotation.random(20, random_state=i).as_matrix() for i in (1, 2))
    sizes = np.sort(rng.uniform(0.2, 2.0, (20, 3)), axis=1)[:, ::-1] * [1.0, 1.0, -1.0]
    matrices = left @ (sizes[..., None] * right)
    nearest = g.project_to_rotation(matrices)
    for matrix, found in zip(matrices, nearest, strict=True):
        wanted, _ = Rotation.align_vectors(matrix.T, np.eye(3))
        assert_allclose(found, wanted.as_matrix(), atol=1e-9)
