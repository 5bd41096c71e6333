"""Fusion of K estimators' poses in V views."""

from __future__ import annotations

from time import perf_counter

import numpy as np
import pytest
from numpy import ndarray
from scipy import stats

from graspcast.errors import InputError
from graspcast.pose.transforms import (
    compose,
    invert,
    rotation_angle,
    rotation_from_vector,
    rotation_vector,
    skew,
    transform,
)
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.fusion import FusedPoses, fuse_poses
from static_scenes import objects, orbit, scattered, seen

SIZES = (0.003, 0.012, 0.07)


def spreads(n: int, k: int, shared: float = 0.0) -> ndarray:
    return np.tile([*SIZES, shared], (n, k, 1))


def world(n: int, v: int, k: int, seed: int = 0, degrees: float = 30.0) -> tuple[ndarray, ...]:
    """Noisy poses (n, v, k), cameras (n, v), and the true poses in the first camera."""
    cameras = orbit(v, degrees=degrees)
    true = np.swapaxes(seen(cameras, objects(n, seed)), 0, 1)  # (n, v, 4, 4)
    poses = scattered(np.repeat(true[:, :, None], k, axis=2), seed + 1, SIZES)
    cam_T_view = np.tile(compose(invert(cameras[:1]), cameras), (n, 1, 1, 1))
    return poses, cam_T_view, np.ones((n, v, k), bool), true[:, 0]


def errors(poses: FusedPoses, true: ndarray) -> ndarray:
    """Position and rotation vector, (n, 6)."""
    turn = rotation_vector(true[:, :3, :3] @ np.swapaxes(poses.cam_T_obj[:, :3, :3], 1, 2))
    return np.concatenate([true[:, :3, 3] - poses.cam_T_obj[:, :3, 3], turn], axis=1)


@pytest.mark.parametrize(("v", "k"), [(1, 1), (1, 3), (2, 1), (3, 2), (5, 3)])
def test_exact_poses_fuse_to_themselves(v: int, k: int) -> None:
    _, cameras, there, true = world(5, v, k)
    poses = np.repeat((invert(cameras) @ true[:, None])[:, :, None], k, axis=2)
    fused = fuse_poses(poses, cameras, there, spreads(5, k))
    np.testing.assert_allclose(fused.cam_T_obj, true, atol=1e-9)
    assert fused.used.all() and not fused.dropped.any()


def test_one_estimate_keeps_its_pose_and_has_its_spread() -> None:
    poses, cameras, there, _ = world(3, 1, 1)
    fused = fuse_poses(poses, cameras, there, spreads(3, 1))
    np.testing.assert_allclose(fused.cam_T_obj, poses[:, 0, 0], atol=1e-12)
    distance = np.linalg.norm(poses[:, 0, 0, :3, 3], axis=1)
    np.testing.assert_allclose(fused.along_m, SIZES[1] * distance)
    np.testing.assert_allclose(fused.across_m, SIZES[0] * distance)
    np.testing.assert_allclose(fused.rotation_rad, SIZES[2])
    np.testing.assert_array_equal(fused.parallax_rad, 0)


def test_one_view_is_a_weighted_mean() -> None:
    """The better of two estimators that agree weighs as the inverse of its variance."""
    poses, cameras, there, true = world(1, 1, 2)
    poses[0, 0] = true[0]
    poses[0, 0, 1, :3, 3] *= 1.0005  # along the ray
    given = np.array([[[*SIZES, 0.0], [*(2 * np.array(SIZES)), 0.0]]])
    fused = fuse_poses(poses, cameras, there, given)
    moved = np.linalg.norm(fused.cam_T_obj[0, :3, 3]) / np.linalg.norm(true[0, :3, 3]) - 1
    assert moved == pytest.approx(0.0005 / 5, rel=0.01)


@pytest.mark.parametrize("k", [1, 3])
def test_covariances_are_calibrated(k: int) -> None:
    poses, cameras, there, true = world(1500, 3, k)
    fused = fuse_poses(poses, cameras, there, spreads(1500, k))
    error = errors(fused, true)
    for part in (slice(0, 3), slice(3, 6)):
        inverse = np.linalg.inv(fused.covariance[:, part, part])
        chi2 = np.einsum("ni,nij,nj->n", error[:, part], inverse, error[:, part])
        assert np.median(chi2) == pytest.approx(stats.chi2(3).median(), rel=0.15)
        assert np.mean(chi2 < stats.chi2(3).ppf(0.9)) == pytest.approx(0.9, abs=0.05)


def test_errors_that_estimators_share_do_not_shrink_with_their_number() -> None:
    poses, cameras, there, _ = world(20, 1, 3)
    alone = fuse_poses(poses[:, :, :1], cameras, there[:, :, :1], spreads(20, 1, 0.5))
    three = fuse_poses(poses, cameras, there, spreads(20, 3, 0.5))
    free = fuse_poses(poses, cameras, there, spreads(20, 3, 0.0))
    expected = np.sqrt(0.5 + 0.5 / 3)
    assert np.median(three.along_m / alone.along_m) == pytest.approx(expected, rel=0.05)
    assert np.median(free.along_m / alone.along_m) == pytest.approx(np.sqrt(1 / 3), rel=0.05)


@pytest.mark.slow
def test_noise_of_the_motion_widens_the_covariance_and_stays_calibrated() -> None:
    noise = CameraNoise(0.004, np.deg2rad(0.3))
    poses, cameras, there, true = world(1500, 3, 2)
    rng = np.random.default_rng(5)
    by = transform(
        rotation_from_vector(rng.normal(0, noise.rotation_rad, (1500, 2, 3))),
        rng.normal(0, noise.translation_m, (1500, 2, 3)),
    )
    cameras = np.concatenate([cameras[:, :1], cameras[:, 1:] @ by], axis=1)
    told = fuse_poses(poses, cameras, there, spreads(1500, 2), noise=noise)
    untold = fuse_poses(poses, cameras, there, spreads(1500, 2))
    assert (told.along_m > untold.along_m).mean() > 0.98  # some drop a view instead
    error = errors(told, true)[:, :3]
    inverse = np.linalg.inv(told.covariance[:, :3, :3])
    chi2 = np.einsum("ni,nij,nj->n", error, inverse, error)
    assert np.median(chi2) == pytest.approx(stats.chi2(3).median(), rel=0.15)
    size = [np.median(np.linalg.norm(errors(f, true)[:, :3], axis=1)) for f in (told, untold)]
    assert size[0] <= size[1] * 1.02


def test_noise_may_differ_by_view() -> None:
    poses, cameras, there, _ = world(4, 3, 2)
    given = (poses, cameras, there, spreads(4, 2))
    all_alike = np.tile([0.004, 0.005], (4, 3, 1))
    for noise in (all_alike, np.where(np.arange(3)[:, None] == 0, 9.0, all_alike)):  # 0 is not used
        np.testing.assert_array_equal(
            fuse_poses(*given, noise=noise).cam_T_obj,
            fuse_poses(*given, noise=CameraNoise(0.004, 0.005)).cam_T_obj,
        )
    lost = all_alike.copy()
    lost[:, 2] = 1e300
    without = fuse_poses(poses[:, :2], cameras[:, :2], there[:, :2], *given[3:], noise=lost[:, :2])
    np.testing.assert_allclose(
        fuse_poses(*given, noise=lost).cam_T_obj, without.cam_T_obj, atol=1e-6
    )


@pytest.mark.ill_typed
def test_noise_that_is_none_is_refused() -> None:
    poses, cameras, there, _ = world(4, 3, 2)
    sizes = np.tile([0.004, 0.005], (4, 3, 1))
    for wrong, says in ((sizes[:, :2], r"\(4, 3, 2\)"), (-sizes, "0 or"), (sizes * np.nan, "0 or")):
        with pytest.raises(InputError, match=f"noise should be {says}"):
            fuse_poses(poses, cameras, there, spreads(4, 2), noise=wrong)


def test_a_second_view_removes_the_error_along_the_ray() -> None:
    poses, cameras, there, true = world(300, 3, 1)
    one = fuse_poses(poses[:, :1], cameras[:, :1], there[:, :1], spreads(300, 1))
    three = fuse_poses(poses, cameras, there, spreads(300, 1))
    sizes = [np.median(np.linalg.norm(errors(f, true)[:, :3], axis=1)) for f in (one, three)]
    assert sizes[1] < sizes[0] / 2
    assert (three.along_m < one.along_m / 2).all()


def test_the_order_of_views_and_estimators_makes_no_difference() -> None:
    poses, cameras, there, _ = world(50, 4, 3)
    poses[:10, 2, 1, :3, 3] += 0.2
    given = spreads(50, 3)
    given[:, 1] *= 1.5
    fused = fuse_poses(poses, cameras, there, given)
    views, names = np.array([0, 3, 1, 2]), np.array([2, 0, 1])
    other = fuse_poses(
        poses[:, views][:, :, names], cameras[:, views], there, given[:, names], principal=1
    )
    np.testing.assert_allclose(other.cam_T_obj, fused.cam_T_obj, atol=1e-6)
    np.testing.assert_allclose(other.covariance, fused.covariance, atol=1e-8)
    np.testing.assert_array_equal(other.used, fused.used[:, views][:, :, names])


def test_the_covariance_turns_with_the_object() -> None:
    poses, cameras, there, _ = world(3, 2, 1)
    fused = fuse_poses(poses, cameras, there, spreads(3, 1))
    R = fused.cam_T_obj[:, :3, :3]
    back = R @ fused.covariance_obj[:, :3, :3] @ np.swapaxes(R, 1, 2)
    np.testing.assert_allclose(back, fused.covariance[:, :3, :3], atol=1e-14)
    assert (np.linalg.eigvalsh(fused.covariance_obj) > 0).all()


def test_a_view_that_contradicts_the_others_is_dropped() -> None:
    poses, cameras, there, _ = world(40, 3, 2)
    clean = fuse_poses(poses[:, :2], cameras[:, :2], there[:, :2], spreads(40, 2))
    poses[:, 2, :, :3, 3] += [0.15, 0.0, 0.0]  # the object was moved
    fused = fuse_poses(poses, cameras, there, spreads(40, 2))
    assert fused.dropped[:, 2].all() and not fused.dropped[:, :2].any()
    np.testing.assert_allclose(fused.cam_T_obj, clean.cam_T_obj, atol=1e-4)


def test_a_gross_error_in_the_judged_image_is_found_by_the_others() -> None:
    poses, cameras, there, true = world(40, 3, 1)
    poses[:, 0, 0, :3, 3] *= 1.3
    fused = fuse_poses(poses, cameras, there, spreads(40, 1))
    assert fused.dropped[:, 0].all() and fused.used[:, 1:].all()
    assert np.median(np.linalg.norm(errors(fused, true)[:, :3], axis=1)) < 0.01


@pytest.mark.parametrize("k", [1, 3])
def test_of_two_views_that_contradict_each_other_the_judged_one_remains(k: int) -> None:
    poses, cameras, there, _ = world(40, 2, k)
    poses[:, 1, :, :3, 3] += [0.2, 0.1, 0.0]
    fused = fuse_poses(poses, cameras, there, spreads(40, k))
    alone = fuse_poses(poses[:, :1], cameras[:, :1], there[:, :1], spreads(40, k))
    assert fused.dropped[:, 1].all() and fused.used[:, 0].any(axis=1).all()
    np.testing.assert_allclose(fused.cam_T_obj, alone.cam_T_obj, atol=1e-6)


def test_of_two_estimators_that_contradict_each_other_the_principal_remains() -> None:
    poses, cameras, there, _ = world(10, 1, 2)
    poses[:, 0, 0, :3, 3] += [0.2, 0.0, 0.0]
    for principal in (0, 1):
        fused = fuse_poses(poses, cameras, there, spreads(10, 2), principal=principal)
        np.testing.assert_allclose(fused.cam_T_obj, poses[:, 0, principal], atol=1e-9)
        assert fused.used[:, 0, principal].all() and fused.dropped[:, 0, 1 - principal].all()


def test_missing_estimates_make_no_difference() -> None:
    poses, cameras, there, _ = world(20, 3, 2)
    there[:, 1, 1] = there[:, 2] = False
    poses[~there] = np.nan
    fused = fuse_poses(poses, cameras, there, spreads(20, 2))
    two = fuse_poses(poses[:, :2], cameras[:, :2], there[:, :2], spreads(20, 2))
    np.testing.assert_allclose(fused.cam_T_obj, two.cam_T_obj, atol=1e-12)
    assert not (fused.used & ~there).any() and not (fused.dropped & ~there).any()


def test_symmetric_equivalents_are_the_same_pose() -> None:
    poses, cameras, there, _ = world(30, 3, 2)
    angles = np.arange(12) * 2 * np.pi / 12
    turns = rotation_from_vector(angles[:, None] * [0.0, 0.0, 1.0])
    symmetries = transform(turns, np.zeros(3))
    rng = np.random.default_rng(3)
    turned = poses @ symmetries[rng.integers(0, 12, there.shape)]
    plain = fuse_poses(poses, cameras, there, spreads(30, 2))
    fused = fuse_poses(turned, cameras, there, spreads(30, 2), symmetries=[symmetries] * 30)
    assert fused.used.all()
    np.testing.assert_allclose(fused.cam_T_obj[:, :3, 3], plain.cam_T_obj[:, :3, 3], atol=1e-6)
    between = np.swapaxes(plain.cam_T_obj[:, None, :3, :3], -1, -2) @ (
        fused.cam_T_obj[:, None, :3, :3] @ turns
    )
    assert rotation_angle(between).min(axis=1).max() < 1e-4
    assert fuse_poses(turned, cameras, there, spreads(30, 2)).dropped.any()


@pytest.mark.slow
def test_ten_thousand_instances_take_seconds() -> None:
    poses, cameras, there, _ = world(10_000, 3, 3)
    start = perf_counter()
    fuse_poses(poses, cameras, there, spreads(10_000, 3))
    assert perf_counter() - start < 20  # 2 s on an idle core


def test_nothing_fuses_to_nothing() -> None:
    poses, cameras, there, _ = world(1, 2, 2)
    fused = fuse_poses(poses[:0], cameras[:0], there[:0], spreads(0, 2))
    assert fused.cam_T_obj.shape == (0, 4, 4) and len(fused.along_m) == 0


@pytest.mark.ill_typed
def test_wrong_shapes_and_lacking_estimates_are_refused() -> None:
    poses, cameras, there, _ = world(4, 2, 2)
    with pytest.raises(InputError, match=r"spread should be \(4, 2, 4\)"):
        fuse_poses(poses, cameras, there, spreads(3, 2))
    with pytest.raises(InputError, match="symmetries of 1 objects for 4"):
        fuse_poses(poses, cameras, there, spreads(4, 2), symmetries=[np.eye(4)[None]])
    there[2, 0] = False
    with pytest.raises(InputError, match="no estimate in the judged image"):
        fuse_poses(poses, cameras, there, spreads(4, 2))
    there[2, 0] = True
    poses[1, 1, 1] = np.nan
    with pytest.raises(InputError, match="not finite"):
        fuse_poses(poses, cameras, there, spreads(4, 2))


def in_ray(across: float, along: float, ray: ndarray) -> ndarray:
    """The covariance with these variances across and along a unit vector."""
    return np.asarray(across * np.eye(3) + (along - across) * np.outer(ray, ray))


@pytest.mark.parametrize("moved", [False, True])
def test_the_covariance_of_estimates_that_agree_adds_their_information(moved: bool) -> None:
    """By estimators within a view, by views after what a view's estimators share."""
    n, v, k = 3, 4, 3
    _, cam_T_view, there, true = world(n, v, k)
    poses = np.repeat((invert(cam_T_view) @ true[:, None])[:, :, None], k, axis=2)
    rng = np.random.default_rng(0)
    there = rng.random((n, v, k)) < 0.6
    there[:, 0, 0] = True
    spread = rng.uniform(0.5, 2.0, (n, k, 4)) * [*SIZES, 0.3]
    noise = rng.uniform(0.5, 2.0, (n, v, 2)) * [0.002, 0.003]
    motion = np.zeros((n, v, 6, 6))
    if moved:
        half = rng.normal(size=(n, v, 6, 6)) * 1e-3
        motion = half @ np.swapaxes(half, 2, 3)
        motion[:, 0] = 0.0
    given = {"noise": noise, "motion_covariance": motion}
    fused = fuse_poses(poses, cam_T_view, there, spread, **given)
    np.testing.assert_allclose(fused.cam_T_obj, true, atol=1e-9)
    for i in range(n):
        information, precision = np.zeros((3, 3)), 0.0
        for j in np.flatnonzero(there[i].any(axis=1)).tolist():
            position = poses[i, j, 0, :3, 3]
            far = float(np.linalg.norm(position))
            ray = cam_T_view[i, j, :3, :3] @ position / far
            own, turn, shared, shared_turn = np.zeros((3, 3)), 0.0, [], []
            for e in np.flatnonzero(there[i, j]).tolist():
                across, along, angle, share = np.square(spread[i, e]) * [far**2, far**2, 1, 1]
                share = spread[i, e, 3]
                own += np.linalg.inv((1 - share) * in_ray(across, along, ray))
                turn += 1 / ((1 - share) * angle)
                shared.append(share * in_ray(across, along, ray))
                shared_turn.append(share * angle)
            total = np.linalg.inv(own) + np.mean(shared, axis=0)
            total_turn = 1 / turn + np.mean(shared_turn)
            if j:
                metres, radians = np.square(noise[i, j])
                total += in_ray(metres + radians * far**2, metres, ray)
                total_turn += radians
                jacobian = np.hstack([np.eye(3), -skew(true[i, :3, 3])])
                total += jacobian @ motion[i, j] @ jacobian.T
                total_turn += np.trace(motion[i, j, 3:, 3:]) / 3
            information += np.linalg.inv(total)
            precision += 1 / total_turn
        found = fused.covariance[i]
        np.testing.assert_allclose(found[:3, :3], np.linalg.inv(information), rtol=1e-6)
        np.testing.assert_allclose(found[3:, 3:], np.eye(3) / precision, rtol=1e-6)
        np.testing.assert_allclose(found[:3, 3:], 0)


def test_parallax_is_the_largest_angle_between_views_that_enter() -> None:
    _, cam_T_view, there, true = world(4, 5, 2, degrees=20.0)
    poses = np.repeat((invert(cam_T_view) @ true[:, None])[:, :, None], 2, axis=2)
    there[1, 4] = False
    there[2, 1:] = False
    there[3, 1:4] = False
    fused = fuse_poses(poses, cam_T_view, there, spreads(4, 2))
    for i in range(4):
        centres = cam_T_view[i, there[i].any(axis=1), :3, 3]
        rays = true[i, :3, 3] - centres
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        wanted = np.arccos(np.clip(rays @ rays.T, -1, 1)).max()
        assert fused.parallax_rad[i] == pytest.approx(wanted, abs=1e-7)


def test_an_outlier_among_many_has_the_weight_of_cauchy() -> None:
    """Of estimates in one view, along one axis, the fused one has the least loss."""
    n, k = 40, 5
    _, cameras, there, true = world(n, 1, k)
    rng = np.random.default_rng(3)
    poses = np.repeat(true[:, None, None], k, axis=2)
    poses[..., :3, 3] += rng.normal(0, 0.002, (n, 1, k, 3))
    fused = fuse_poses(poses, cameras, there, spreads(n, k))
    assert fused.used.all()
    for i in range(0, n, 5):
        found = fused.cam_T_obj[i, :3, 3]
        weights, information = [], []
        for e in range(k):
            t = poses[i, 0, e, :3, 3]
            far = float(np.linalg.norm(t))
            inverse = np.linalg.inv(in_ray((SIZES[0] * far) ** 2, (SIZES[1] * far) ** 2, t / far))
            distance = (t - found) @ inverse @ (t - found)
            weights.append(1 / (1 + distance / 6))
            information.append(weights[-1] * inverse)
        mean = np.linalg.solve(
            np.sum(information, axis=0),
            sum(w @ poses[i, 0, e, :3, 3] for e, w in enumerate(information)),
        )
        np.testing.assert_allclose(found, mean, atol=1e-6)


@pytest.mark.parametrize("principal", [0, 1, 2])
def test_where_no_two_agree_the_principals_estimate_remains(principal: int) -> None:
    poses, cameras, there, _ = world(6, 1, 3)
    poses[:, 0, :, :3, 3] += 0.3 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]])
    there[4:, 0, (principal + 1) % 3] = False
    fused = fuse_poses(poses, cameras, there, spreads(6, 3), principal=principal)
    alone = np.arange(3) == principal
    for i in range(6):
        np.testing.assert_array_equal(fused.used[i, 0], alone)
        np.testing.assert_array_equal(fused.dropped[i, 0], there[i, 0] & ~alone)
        np.testing.assert_allclose(fused.cam_T_obj[i], poses[i, 0, principal], atol=1e-9)


def test_symmetric_turns_are_no_contradiction_and_others_are() -> None:
    half_turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    poses, cameras, there, true = world(4, 3, 2)
    poses[:, 1] = poses[:, 1] @ half_turn
    poses[:, 0, 1] = poses[:, 0, 1] @ half_turn
    two, one = np.stack([np.eye(4), half_turn]), np.eye(4)[None]
    fused = fuse_poses(poses, cameras, there, spreads(4, 2), symmetries=[two, one, two, one])
    for i in range(4):
        if i % 2 == 0:  # the pose, or the one that looks the same
            off = min(np.linalg.norm(errors(fused, true @ s)[i, 3:]) for s in two)
            assert fused.used[i].all() and off < 0.3
        else:
            assert fused.dropped[i].any()
