"""From where to look next."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy import ndarray

from graspcast.errors import InputError
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.views.association import position_covariance
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.choice import MIN_PARALLAX_RAD
from graspcast.views.next_look import (
    MAX_TURN_RAD,
    further_view,
    next_directions,
    next_look,
    next_looks,
)
from graspcast.views.spread import DEFAULT_SPREAD
from poses import random_poses

SPREAD = np.array([0.003, 0.012, 0.07, 0.5])
seeds = st.integers(0, 2**32 - 1)


def ahead(depth_m: float = 1.0) -> ndarray:
    return transform(np.eye(3), np.array([0.0, 0.0, depth_m]))


def covariance_of(position: ndarray, rotation_sd: float = 0.07) -> ndarray:
    out = np.zeros((6, 6))
    out[:3, :3] = position
    out[3:, 3:] = rotation_sd**2 * np.eye(3)
    return out


def one_look(pose: ndarray) -> ndarray:
    """The covariance of the pose from one image."""
    return covariance_of(position_covariance(pose[None, :3, 3], SPREAD)[0])


def camera(direction: ndarray, distance: float, target: ndarray) -> ndarray:
    """A view's camera in the judged camera's frame; its rotation does not matter here."""
    return transform(np.eye(3), target + distance * direction)


def angle(a: ndarray, b: ndarray) -> float:
    return float(np.arccos(np.clip(a @ b, -1, 1)))


def worst(pose: ndarray, covariance: ndarray, direction: ndarray) -> float:
    after = further_view(covariance[None], pose[None], direction[None]).covariance[0]
    return float(np.sqrt(np.linalg.eigvalsh(after[:3, :3])[-1]))


def test_after_one_look_it_is_from_the_cameras_right() -> None:
    look = next_look(ahead(), one_look(ahead()))
    np.testing.assert_allclose(look.direction, [np.sqrt(3) / 2, 0, -0.5], atol=1e-9)
    np.testing.assert_allclose(look.axis, [0, 0, 1], atol=1e-9)
    assert look.axis_sd_m == pytest.approx(0.012)
    assert look.angle_rad == pytest.approx(np.pi / 3)
    assert look.direction_world is None
    assert look.expected_probability is None
    assert "60 degrees" in str(look)
    assert "camera frame" in str(look)


@given(seeds)
def test_what_is_suggested_is_a_look_that_helps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = random_poses(1, seed)[0]
    half = rng.normal(scale=0.01, size=(3, 3))
    covariance = covariance_of(half @ half.T)
    look = next_look(pose, covariance)
    assert np.linalg.norm(look.direction) == pytest.approx(1)
    assert np.linalg.norm(look.axis) == pytest.approx(1)
    now = -pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    assert look.angle_rad == pytest.approx(angle(now, look.direction), abs=1e-6)
    assert MIN_PARALLAX_RAD <= look.angle_rad <= MAX_TURN_RAD + 1e-9
    assert (look.direction - now)[1] <= np.sin(np.deg2rad(15)) + 1e-9, "it looks from below"
    assert worst(pose, covariance, look.direction) < look.axis_sd_m
    # Where one can get perpendicular to the axis, without going down, that is what is suggested.
    across = now - (now @ look.axis) * look.axis
    turn = angle(now, across / np.linalg.norm(across))
    down = (across / np.linalg.norm(across) - now)[1] > np.sin(np.deg2rad(15))
    if MIN_PARALLAX_RAD * 1.3 < turn < MAX_TURN_RAD and not down:
        assert look.direction @ look.axis == pytest.approx(0, abs=1e-6)
        assert look.angle_rad == pytest.approx(turn, abs=1e-6)


@given(seeds)
def test_the_world_may_be_turned(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = random_poses(1, seed)[0]
    half = rng.normal(scale=0.01, size=(3, 3))
    covariance = covariance_of(half @ half.T)
    world_T_cam = transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    turn = transform(rotation_from_vector(rng.normal(size=3)), rng.normal(size=3))
    first = next_look(pose, covariance, world_T_cam)
    other = next_look(pose, covariance, turn @ world_T_cam)
    assert first.direction_world is not None
    assert other.direction_world is not None
    np.testing.assert_array_equal(first.direction, other.direction)
    np.testing.assert_allclose(
        other.direction_world, turn[:3, :3] @ first.direction_world, atol=1e-9
    )
    assert "world frame" in str(first)


@given(seeds, st.integers(1, 4))
def test_it_is_from_nowhere_one_has_looked_from(seed: int, views: int) -> None:
    rng = np.random.default_rng(seed)
    pose = random_poses(1, seed)[0]
    target, distance = pose[:3, 3], float(np.linalg.norm(pose[:3, 3]))
    cameras = [np.eye(4)]
    for _ in range(views):
        away = -target / distance + rng.normal(scale=0.5, size=3)
        cameras.append(camera(away / np.linalg.norm(away), distance, target))
    covariance = one_look(pose)
    look = next_look(pose, covariance, cam_T_view=np.stack(cameras))
    for one in cameras:
        towards = (one[:3, 3] - target) / np.linalg.norm(one[:3, 3] - target)
        assert angle(towards, look.direction) >= MIN_PARALLAX_RAD - 1e-9
    assert look.angle_rad <= MAX_TURN_RAD + 1e-9
    assert worst(pose, covariance, look.direction) < look.axis_sd_m


def test_a_look_from_the_right_is_followed_by_another_side() -> None:
    pose = ahead()
    first = next_look(pose, one_look(pose))
    cameras = np.stack([np.eye(4), camera(first.direction, 1, pose[:3, 3])])
    second = next_look(pose, one_look(pose), cam_T_view=cameras)
    assert angle(first.direction, second.direction) > MIN_PARALLAX_RAD


def test_views_all_around_still_get_an_answer() -> None:
    pose = ahead()
    grid = np.random.default_rng(0).normal(size=(400, 3))
    grid /= np.linalg.norm(grid, axis=1, keepdims=True)
    cameras = np.stack([camera(d, 1.0, pose[:3, 3]) for d in grid])
    look = next_look(pose, one_look(pose), cam_T_view=cameras)
    assert np.isfinite(look.direction).all()
    assert look.angle_rad <= MAX_TURN_RAD + 1e-9


@pytest.mark.parametrize(
    "position",
    [
        np.zeros((3, 3)),
        1e-6 * np.eye(3),
        np.diag([1e-4, 1e-4, 0]),
        np.diag([0, 0, 1e-4]),
        np.diag([1e-4, 0, 0]),
        np.diag([0, 1e-30, 0]),
        np.full((3, 3), 1e-4),
        1e6 * np.eye(3),
    ],
)
def test_degenerate_covariances(position: ndarray) -> None:
    for pose in (ahead(), ahead(1e-3), transform(np.eye(3), np.array([3.0, 0.0, 1e-9]))):
        look = next_look(pose, covariance_of(position))
        assert np.linalg.norm(look.direction) == pytest.approx(1)
        assert np.linalg.norm(look.axis) == pytest.approx(1)
        assert look.axis_sd_m == pytest.approx(np.sqrt(np.linalg.eigvalsh(position)[-1]), rel=1e-6)
        assert MIN_PARALLAX_RAD <= look.angle_rad <= MAX_TURN_RAD + 1e-9


def test_equal_variances_count_as_one_look() -> None:
    look = next_look(ahead(), covariance_of(1e-6 * np.eye(3)))
    np.testing.assert_allclose(look.axis, [0, 0, 1], atol=1e-9)


def test_many_are_as_one_by_one() -> None:
    poses = random_poses(20, 3)
    rng = np.random.default_rng(4)
    half = rng.normal(scale=0.01, size=(20, 3, 3))
    covariances = np.stack([covariance_of(h @ h.T) for h in half])
    cameras = np.stack([random_poses(20, 5), random_poses(20, 6)], axis=1)
    seen = rng.random((20, 2)) < 0.5
    for i, look in enumerate(next_looks(poses, covariances, cam_T_view=cameras, seen=seen)):
        alone = next_look(
            poses[i], covariances[i], cam_T_view=cameras[i, seen[i]] if seen[i].any() else None
        )
        np.testing.assert_allclose(look.direction, alone.direction, atol=1e-9)
    assert next_looks(np.zeros((0, 4, 4)), np.zeros((0, 6, 6))) == []


def test_the_update_is_kalmans() -> None:
    poses = random_poses(5, 1)
    rng = np.random.default_rng(2)
    half = rng.normal(scale=0.01, size=(5, 3, 3))
    before = np.stack([covariance_of(h @ h.T) for h in half])
    direction = rng.normal(size=(5, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    found = further_view(before, poses, direction, noise=CameraNoise(0.001, 0.002))
    wanted = np.linalg.inv(np.linalg.inv(before) + np.linalg.inv(found.noise))
    np.testing.assert_allclose(found.covariance, wanted, rtol=1e-6, atol=1e-15)
    np.testing.assert_allclose(
        found.gain, before @ np.linalg.inv(before + found.noise), rtol=1e-6, atol=1e-12
    )
    kept = np.eye(6) - found.gain
    spread = kept @ before @ np.swapaxes(kept, 1, 2)
    spread += found.gain @ found.noise @ np.swapaxes(found.gain, 1, 2)
    np.testing.assert_allclose(spread, wanted, rtol=1e-6, atol=1e-15)


def test_a_view_says_what_its_spread_and_the_noise_allow() -> None:
    side = np.array([[1.0, 0.0, 0.0]])
    before = one_look(ahead())[None]
    alone = further_view(before, ahead()[None], side).noise[0]
    np.testing.assert_allclose(np.diag(alone)[:3], np.square([0.012, 0.003, 0.003]), rtol=1e-9)
    np.testing.assert_allclose(np.diag(alone)[3:], 0.07**2, rtol=1e-9)
    noisy = further_view(before, ahead()[None], side, noise=CameraNoise(0.003, 0.005)).noise[0]
    assert noisy[1, 1] == pytest.approx(0.003**2 + 0.003**2 + 0.005**2)
    assert noisy[3, 3] == pytest.approx(0.07**2 + 0.005**2)
    three = further_view(before, ahead()[None], side, estimators=3).noise[0]
    share = DEFAULT_SPREAD.shared
    np.testing.assert_allclose(three, alone * (share + (1 - share) / 3), atol=1e-15)


def test_what_is_not_a_pose_or_leaves_no_room_is_said() -> None:
    broken = one_look(ahead())
    broken[0, 0] = np.nan
    with pytest.raises(InputError, match="not finite"):
        next_look(ahead(), broken)
    with pytest.raises(InputError, match="greatest turn should be"):
        next_directions(
            ahead()[None], one_look(ahead())[None], min_parallax_rad=1.0, max_turn_rad=1.1
        )


def directions_about(now: ndarray, n: int, most: float) -> ndarray:
    """Random directions, at most so far from one."""
    rng = np.random.default_rng(0)
    towards = np.cross(now, rng.normal(size=(n, 3)))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    turn = rng.uniform(0, most, n)[:, None]
    return np.cos(turn) * now + np.sin(turn) * towards


@pytest.mark.parametrize("seed", range(6))
def test_where_the_best_side_is_taken_the_best_of_the_others_is_suggested(seed: int) -> None:
    pose = random_poses(1, seed)[0]
    target, distance = pose[:3, 3], float(np.linalg.norm(pose[:3, 3]))
    rng = np.random.default_rng(seed)
    half = rng.normal(scale=0.01, size=(3, 3)) * [1.0, 2.0, 3.0]
    covariance = covariance_of(half @ half.T)
    first = next_look(pose, covariance)
    taken = np.stack([np.eye(4), camera(first.direction, distance, target)])
    look = next_look(pose, covariance, cam_T_view=taken)
    now = -target / distance
    others = directions_about(now, 3000, MAX_TURN_RAD)
    views = np.stack([now, first.direction])
    far = np.arccos(np.clip(others @ views.T, -1, 1))
    allowed = (far >= MIN_PARALLAX_RAD).all(axis=1) & (far[:, 0] >= 1.25 * MIN_PARALLAX_RAD)
    allowed &= (others - now)[:, 1] <= np.sin(np.deg2rad(15.0))
    assert angle(first.direction, look.direction) >= MIN_PARALLAX_RAD
    best = min(worst(pose, covariance, d) for d in others[allowed][:400])
    assert worst(pose, covariance, look.direction) <= 1.03 * best


def test_views_all_around_leave_the_direction_farthest_from_them() -> None:
    pose = ahead()
    now = np.array([0.0, 0.0, -1.0])
    every = directions_about(now, 4000, np.pi / 2)
    hole = np.array([-np.sin(0.8), 0.0, -np.cos(0.8)])
    kept = every[np.arccos(every @ hole) > 0.75 * MIN_PARALLAX_RAD]
    cameras = np.stack([camera(d, 1.0, pose[:3, 3]) for d in [now, *kept]])
    look = next_look(pose, one_look(pose), cam_T_view=cameras)
    gaps = np.arccos(np.clip(look.direction @ np.vstack([now, kept]).T, -1, 1))
    assert gaps.min() > 0.4 * MIN_PARALLAX_RAD
    assert angle(look.direction, hole) < MIN_PARALLAX_RAD


def test_the_axis_among_equal_ones_is_the_nearest_to_the_ray() -> None:
    pose = random_poses(1, 4)[0]
    ray = pose[:3, 3] / np.linalg.norm(pose[:3, 3])
    basis = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    for sd, flat in (
        ([0.01, 0.01, 0.01], ray),
        ([0.002, 0.01, 0.01], ray - (ray @ basis[:, 0]) * basis[:, 0]),
        ([0.002, 0.01, 0.00995], ray - (ray @ basis[:, 0]) * basis[:, 0]),
        ([0.002, 0.01, 0.0098], basis[:, 1]),  # surely the largest
    ):
        look = next_look(pose, covariance_of(basis @ np.diag(np.square(sd)) @ basis.T))
        wanted = flat / np.linalg.norm(flat)
        np.testing.assert_allclose(look.axis, wanted * np.sign(wanted @ ray), atol=1e-9)
        assert look.axis_sd_m == pytest.approx(0.01)


def test_a_view_from_twice_the_distance_is_less_sure() -> None:
    """Errors are in proportion to the distance of the object from the camera."""
    side = np.array([[0.0, 1.0, 0.0]])
    near, far = (
        further_view(one_look(ahead(d))[None], ahead(d)[None], side).noise[0] for d in (0.5, 2.0)
    )
    np.testing.assert_allclose(far[:3, :3], 16 * near[:3, :3], atol=1e-15)
    np.testing.assert_allclose(far[3:, 3:], near[3:, 3:])


def test_an_axis_across_the_ray_points_to_the_cameras_right() -> None:
    for axis in ([1.0, 0.0, 0.0], [0.8, 0.6, 0.0], [0.6, -0.8, 0.0]):
        position = 1e-6 * np.eye(3) + 1e-4 * np.outer(axis, axis)
        np.testing.assert_allclose(
            next_look(ahead(), covariance_of(position)).axis, axis, atol=1e-9
        )


def test_beside_the_camera_there_is_a_side_to_look_from_too() -> None:
    for x in (2.0, -2.0):
        pose = transform(np.eye(3), np.array([x, 0.0, 0.0]))
        look = next_look(pose, one_look(pose))
        assert MIN_PARALLAX_RAD <= look.angle_rad <= MAX_TURN_RAD + 1e-9
        assert look.direction[1] < 0  # from above, as the camera's right is along the ray


def test_the_greatest_turn_is_at_most_a_right_angle() -> None:
    next_look(ahead(), one_look(ahead()), max_turn_rad=np.pi / 2)
    for turn in (np.pi / 2 + 0.01, 3.0):
        with pytest.raises(InputError, match="at most 90 degrees"):
            next_look(ahead(), one_look(ahead()), max_turn_rad=turn)
    next_look(ahead(), one_look(ahead()), min_parallax_rad=0.0)
    with pytest.raises(InputError, match="greatest turn should be"):
        next_look(ahead(), one_look(ahead()), min_parallax_rad=-0.01)
