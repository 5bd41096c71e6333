"""Pose errors against plain NumPy, their invariances, and the released figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import read_results
from graspcast.pose import metrics as e
from graspcast.pose.transforms import rotation_from_vector, transform, transform_points
from poses import nudged, random_poses

POINTS = np.random.default_rng(7).normal(scale=0.05, size=(60, 3))
GT = random_poses(12)
EST = nudged(GT, 1)
HALF_TURN = np.stack([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])])
K = np.broadcast_to(np.array([[570.0, 0, 325], [0, 573, 242], [0, 0, 1]]), (12, 3, 3))


def test_against_plain_numpy() -> None:
    a, b = transform_points(EST, POINTS), transform_points(GT, POINTS)
    distance = np.linalg.norm(a - b, axis=-1)
    assert_allclose(e.add(EST, GT, POINTS), distance.mean(axis=1), rtol=1e-12)
    several = e.add(EST[None], np.stack([GT, EST]), np.asfortranarray(POINTS))
    assert_allclose(several, [e.add(EST, GT, POINTS), np.zeros(len(GT))], rtol=1e-12)
    nearest = [cdist(y, x).min(axis=1).mean() for x, y in zip(a, b, strict=True)]
    assert_allclose(e.add_s(EST, GT, POINTS), nearest, rtol=1e-9)
    turned = transform_points(GT @ HALF_TURN[1], POINTS)
    other = np.linalg.norm(a - turned, axis=-1).max(axis=1)
    expected = np.minimum(distance.max(axis=1), other)
    assert_allclose(e.mssd(EST, GT, POINTS, HALF_TURN), expected, rtol=1e-12)

    def pixels(points: np.ndarray) -> np.ndarray:
        seen = points @ K[0].T
        return seen[..., :2] / seen[..., 2:]

    both = [np.linalg.norm(pixels(a) - pixels(p), axis=-1).max(axis=1) for p in (b, turned)]
    assert_allclose(e.mspd(EST, GT, POINTS, HALF_TURN, K), np.minimum(*both), rtol=1e-9)
    oracle = (
        Rotation.from_matrix(EST[:, :3, :3]).inv() * Rotation.from_matrix(GT[:, :3, :3])
    ).magnitude()
    assert_allclose(e.rotation_error(EST, GT), oracle, atol=1e-12)


def test_no_error_is_zero() -> None:
    assert_allclose(e.add(GT, GT, POINTS), 0, atol=1e-15)
    assert_allclose(e.add_s(GT, GT, POINTS), 0, atol=1e-9)
    assert_allclose(e.mssd(GT, GT, POINTS, HALF_TURN), 0, atol=1e-15)
    assert_allclose(e.mspd(GT, GT, POINTS, HALF_TURN, K), 0, atol=1e-9)
    assert_allclose(e.rotation_error(GT, GT), 0, atol=1e-7)
    assert np.isnan(e.ray_share(GT, GT)).all()


def test_the_camera_frame_does_not_matter() -> None:
    moved = random_poses(1, seed=9)
    for measure in (e.rotation_error, e.translation_error):
        assert_allclose(measure(moved @ EST, moved @ GT), measure(EST, GT), atol=1e-9)
    for surface in (e.add, e.add_s):
        assert_allclose(
            surface(moved @ EST, moved @ GT, POINTS), surface(EST, GT, POINTS), atol=1e-12
        )
    assert_allclose(
        e.mssd(moved @ EST, moved @ GT, POINTS, HALF_TURN),
        e.mssd(EST, GT, POINTS, HALF_TURN),
        atol=1e-12,
    )


def test_a_symmetric_turn_of_a_symmetric_object_is_no_error() -> None:
    points = np.concatenate([POINTS, POINTS @ HALF_TURN[1, :3, :3].T])
    turned = GT @ HALF_TURN[1]
    assert_allclose(e.mssd(turned, GT, points, HALF_TURN), 0, atol=1e-12)
    assert_allclose(e.mspd(turned, GT, points, HALF_TURN, K), 0, atol=1e-9)
    assert_allclose(e.add_s(turned, GT, points), 0, atol=1e-9)
    assert_allclose(e.rotation_error(turned, GT, HALF_TURN), 0, atol=1e-7)
    assert (e.add(turned, GT, points) > 0.01).all()


def test_order_of_the_measures() -> None:
    add, add_s = e.add(EST, GT, POINTS), e.add_s(EST, GT, POINTS)
    mssd = e.mssd(EST, GT, POINTS, np.eye(4)[None])
    assert (add_s <= add + 1e-12).all()
    assert (add <= mssd + 1e-12).all()
    assert (e.mssd(EST, GT, POINTS, HALF_TURN) <= mssd + 1e-12).all()


def test_share_of_the_error_along_the_ray() -> None:
    ray = GT[:, :3, 3] / np.linalg.norm(GT[:, :3, 3], axis=-1, keepdims=True)
    across = np.cross(ray, [0.0, 1.0, 0.0])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    for angle in (0.0, 0.4, np.pi / 2):
        shift = 0.03 * (np.cos(angle) * ray + np.sin(angle) * across)
        moved = transform(GT[:, :3, :3], GT[:, :3, 3] + shift)
        assert_allclose(e.ray_share(moved, GT), np.cos(angle), atol=1e-9)


def test_rotation_error_near_zero_and_half_a_turn() -> None:
    for angle in (1e-8, 1e-5, np.pi - 1e-8, np.pi):
        turned = GT @ transform(rotation_from_vector(np.array([angle, 0, 0])), np.zeros(3))
        assert_allclose(e.rotation_error(turned, GT), angle, atol=1e-9)


def released(data_dir: Path, estimator: str) -> dict[tuple[int, int, int], list[float]]:
    folder = data_dir / "raw" / "Consensus-Driven-Uncertainty" / "BOP-Metrics" / estimator / "LMO"
    (path,) = folder.rglob("*.txt")
    lines = [line.split("\t") for line in path.read_text().splitlines() if not line.startswith("#")]
    return {
        (int(f[0]), int(f[1]), int(f[2])): [float(v) for v in f[3:]] for f in lines if len(f) > 3
    }


@pytest.mark.slow
@pytest.mark.parametrize("estimator", ["EPOS", "GDRNPP", "ZebraPose"])
def test_released_metrics_of_lmo(data_dir: Path, published: Path, estimator: str) -> None:
    """ADD(-S), MSSD and MSPD; the released MSSD and MSPD leave symmetries out."""
    dataset = BopDataset(data_dir / "bop" / "lmo", ground_truth=published / "lmo" / "ground_truth")
    results = read_results(published / "lmo" / f"{estimator.lower()}_lmo-test.csv")
    table = released(data_dir, estimator)
    keys = list(
        zip(results.scene_id.tolist(), results.im_id.tolist(), results.obj_id.tolist(), strict=True)
    )
    assert set(keys) == set(table)
    gt = dataset.ground_truth
    row = {
        k: i
        for i, k in enumerate(
            zip(gt.scene_id.tolist(), gt.im_id.tolist(), gt.obj_id.tolist(), strict=True)
        )
    }
    true = gt.cam_T_obj[[row[k] for k in keys]]
    expected = np.array([table[k] for k in keys])
    for obj_id, info in dataset.models.info.items():
        mine = results.obj_id == obj_id
        est, ref, figures = results.cam_T_obj[mine], true[mine], expected[mine]
        points = dataset.models.mesh(obj_id).vertices
        # acos of the trace, as released, is good to 1e-2 degrees near 0 and near 180.
        assert_allclose(
            np.degrees(e.rotation_error(est, ref, info.symmetries)), figures[:, 0], atol=1e-2
        )
        assert_allclose(e.translation_error(est, ref), figures[:, 1], rtol=1e-9)
        none = np.eye(4)[None]
        assert_allclose(e.mssd(est, ref, points, none), figures[:, 12], rtol=1e-9)
        camera = np.broadcast_to(dataset.camera.K, (len(est), 3, 3))
        assert_allclose(e.mspd(est, ref, points, none, camera), figures[:, 13], rtol=1e-6)
        add = e.add_s if info.symmetric else e.add
        assert_allclose(add(est, ref, points), figures[:, 14], rtol=1e-4)
        assert_allclose(info.diameter_m, figures[:, 15], rtol=1e-6)


def test_the_identity_alone_changes_no_pose() -> None:
    assert_allclose(e.nearest_symmetric(EST, np.eye(4)[None]), EST, rtol=0, atol=0)


def about(axis: int, turns: int) -> np.ndarray:
    """Turns about an axis after which a body of so many equal sectors looks alike."""
    vectors = np.zeros((turns, 3))
    vectors[:, axis] = 2 * np.pi / turns * np.arange(turns)
    return transform(Rotation.from_rotvec(vectors).as_matrix(), np.zeros((turns, 3)))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("n", [1, 4095, 4096, 4097])
def test_the_nearest_symmetric_transform_turns_least(axis: int, n: int) -> None:
    symmetries = about(axis, 5)
    symmetries[:, :3, 3] = np.random.default_rng(1).normal(size=(5, 3))  # of an object off centre
    poses = random_poses(n, seed=axis)
    angles = Rotation.from_matrix((poses[:, None] @ symmetries)[..., :3, :3].reshape(-1, 3, 3))
    best = angles.magnitude().reshape(n, 5).argmin(axis=1)
    found = e.nearest_symmetric(poses, symmetries)
    assert_allclose(found, poses @ symmetries[best], atol=1e-12)
    assert set(best) == set(range(5)) or n == 1


def test_the_nearest_symmetric_transform_keeps_the_batch() -> None:
    symmetries = about(2, 3)
    poses = random_poses(6)
    found = e.nearest_symmetric(poses.reshape(2, 3, 4, 4), symmetries)
    assert_allclose(found, e.nearest_symmetric(poses, symmetries).reshape(2, 3, 4, 4))
    assert_allclose(e.nearest_symmetric(poses[0], symmetries), found[0, 0])
    assert_allclose(e.nearest_symmetric(poses, np.eye(4)[None]), poses)


def test_errors_of_one_point_are_those_of_that_point() -> None:
    point = np.array([[0.02, -0.03, 0.05]])
    moved = np.linalg.norm(transform_points(EST, point) - transform_points(GT, point), axis=-1)
    none = np.eye(4)[None]
    assert_allclose(e.add(EST, GT, point), moved[:, 0], rtol=1e-9)
    assert_allclose(e.mssd(EST, GT, point, none), moved[:, 0], rtol=1e-9)


def test_symmetries_are_applied_to_the_estimate() -> None:
    """Of a symmetry file's matrix that is not quite its own inverse, the estimate is turned."""
    symmetries = about(0, 3)[:2]  # without the inverse of the second
    turned = GT @ np.linalg.inv(symmetries[1])
    assert_allclose(e.rotation_error(turned, GT, symmetries), 0, atol=1e-7)
    assert (e.rotation_error(GT @ symmetries[1], GT, symmetries) > 1).all()
    assert_allclose(e.mssd(GT @ symmetries[1], GT, POINTS, symmetries), 0, atol=1e-12)
