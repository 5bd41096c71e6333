"""Association of several instances of an object across views."""

from __future__ import annotations

import numpy as np
import pytest
from numpy import ndarray

from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.views.association import (
    associate,
    associate_views,
    pair_distances,
    position_covariance,
)
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.fusion import CONTRADICTION

SPREAD = np.array([0.003, 0.012, 0.07, 0.5])
ALONE = np.eye(4)[None]


def standing(*x_m: float, turn: float = 0.0) -> ndarray:
    """Objects in a row, 0.8 m away."""
    positions = np.array([[x, 0.0, 0.8] for x in x_m])
    return transform(rotation_from_vector(np.array([0.0, 0.0, turn])), positions)


def between(first: ndarray, second: ndarray, symmetries: ndarray = ALONE) -> ndarray:
    covariances = [position_covariance(p[:, :3, 3], SPREAD) for p in (first, second)]
    return pair_distances(first, covariances[0], second, covariances[1], 0.07, symmetries)


def associated(first: ndarray, second: ndarray) -> tuple[list[int], list[bool]]:
    which, doubted = associate(
        between(first, second), between(first, first), between(second, second)
    )
    return which.tolist(), doubted.tolist()


def test_instances_far_apart_are_told_apart() -> None:
    assert associated(standing(-0.1, 0.0, 0.1), standing(0.101, -0.1, 0.002)) == (
        [1, 2, 0],
        [False] * 3,
    )


def test_an_instance_that_is_not_seen_has_no_partner() -> None:
    assert associated(standing(-0.1, 0.1), standing(0.1)) == ([-1, 0], [False, False])
    assert associated(standing(0.1), standing(0.1, 0.3)) == ([0], [False])
    assert associated(standing(0.1), standing(0.1)[:0]) == ([-1], [False])


def test_two_candidates_within_the_uncertainty_are_doubted() -> None:
    assert associated(standing(0.0), standing(-0.006, 0.006)) == ([-1], [True])
    assert associated(standing(-0.006, 0.006), standing(0.0)) == ([-1, -1], [True, True])


def test_a_double_detection_is_no_doubt() -> None:
    which, doubted = associated(standing(0.0), standing(0.0005, -0.0005))
    assert which[0] in (0, 1) and not doubted[0]


def test_a_wrong_rotation_alone_is_no_other_instance() -> None:
    assert associated(standing(0.0), standing(0.001, turn=2.0)) == ([0], [False])


def test_rotations_tell_apart_what_positions_do_not() -> None:
    first = np.concatenate([standing(0.0), standing(0.004, turn=1.5)])
    assert associated(first, first[::-1].copy()) == ([1, 0], [False, False])


def test_symmetric_equivalents_are_near() -> None:
    half = transform(rotation_from_vector(np.array([0.0, 0.0, np.pi])), np.zeros(3))
    both = np.stack([np.eye(4), half])
    turned = standing(0.0, turn=np.pi)
    assert between(standing(0.0), turned, both)[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert between(standing(0.0), turned)[0, 0] > 20


def test_the_covariance_is_along_the_ray() -> None:
    out = position_covariance(np.array([[0.0, 0.0, 2.0]]), SPREAD)[0]
    np.testing.assert_allclose(np.sqrt(np.diag(out)), [0.006, 0.006, 0.024])
    noise = CameraNoise(0.01, 0.0)
    wider = position_covariance(np.array([[0.0, 0.0, 2.0]]), SPREAD, noise)[0]
    np.testing.assert_allclose(wider - out, 1e-4 * np.eye(3), atol=1e-12)


def test_noise_of_the_motion_makes_near_instances_doubtful() -> None:
    side = transform(rotation_from_vector(np.array([0.0, 0.5, 0.0])), np.array([-0.38, 0.0, 0.1]))
    mine = standing(-0.05, 0.05)
    view_T_obj = np.linalg.inv(side) @ mine[::-1]
    for noise, expected in ((CameraNoise(), [1, 0]), (CameraNoise(0.1, 0.0), [-1, -1])):
        which, doubted = associate_views(mine, view_T_obj, side, (SPREAD, SPREAD), noise, ALONE)
        assert which.tolist() == expected and (doubted == (which < 0)).all()


def test_positions_are_less_sure_along_the_ray_and_with_the_motion() -> None:
    rng = np.random.default_rng(0)
    position = rng.normal(size=(6, 3)) + [0.0, 0.0, 2.0]
    spread = np.array([0.003, 0.012, 0.07, 0.5])
    noise = CameraNoise(0.004, 0.005)
    for i, covariance in enumerate(position_covariance(position, spread, noise)):
        distance = np.linalg.norm(position[i])
        ray = position[i] / distance
        side = np.cross(ray, [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        along = (0.012 * distance) ** 2 + 0.004**2
        across = (0.003**2 + 0.005**2) * distance**2 + 0.004**2
        np.testing.assert_allclose(covariance @ ray, along * ray, atol=1e-12)
        np.testing.assert_allclose(covariance @ side, across * side, atol=1e-12)
        np.testing.assert_allclose(np.trace(covariance), along + 2 * across)
    still = position_covariance(position, spread)
    np.testing.assert_array_equal(still, position_covariance(position, spread, CameraNoise()))


def test_distances_are_of_position_and_rotation() -> None:
    """Mahalanobis' of the position, and half the square of the angle over its deviation."""
    first = standing(0.0, 0.01)
    second = standing(0.002, turn=0.05)
    second[0, :3, 3] += [0.0, 0.001, 0.004]
    sides = [position_covariance(p[:, :3, 3], SPREAD) for p in (first, second)]
    found = pair_distances(first, sides[0], second, sides[1], 0.07, ALONE)
    for i in range(2):
        error = first[i, :3, 3] - second[0, :3, 3]
        position = error @ np.linalg.solve(sides[0][i] + sides[1][0], error)
        assert found[i, 0] == pytest.approx(position + (0.05 / 0.07) ** 2 / 2)
    # However wrong, a rotation alone makes no other instance of it.
    half_turn = pair_distances(first, sides[0], standing(0.0, turn=np.pi), sides[1], 0.07, ALONE)
    other = pair_distances(first, sides[0], standing(0.0, turn=1.5), sides[1], 0.07, ALONE)
    assert half_turn[0, 0] == other[0, 0] == pytest.approx(CONTRADICTION / 2)
    again = pair_distances(
        first,
        sides[0],
        standing(0.0, turn=np.pi),
        sides[1],
        0.07,
        np.stack([np.eye(4), np.diag([-1.0, -1.0, 1.0, 1.0])]),
    )
    assert again[0, 0] == pytest.approx(0.0, abs=1e-9)
