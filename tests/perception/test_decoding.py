"""From what a network says to a pose: networks that are right, or partly right, by construction."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.perception.crops import Crop
from graspcast.perception.dense import DenseEstimator, expected_coordinates
from graspcast.perception.direct import DirectEstimator
from graspcast.perception.keypoints import KeypointEstimator, heat_map_peaks
from graspcast.perception.network import CropEstimator, TrainedObject
from graspcast.perception.pnp import pose_from_points
from graspcast.pose.transforms import rotation_angle, transform_points
from poses import random_poses

pytest.importorskip("poselib", reason="PoseLib is not installed (extra estimators)")

K = np.array([[572.4, 0.0, 325.3], [0.0, 573.6, 242.0], [0.0, 0.0, 1.0]])
RNG = np.random.default_rng(0)
TRAINED = TrainedObject(
    obj_id=3,
    diameter_m=0.25,
    lower=np.array([-0.05, -0.04, -0.1]),
    size=np.array([0.1, 0.08, 0.2]),
    keypoints=RNG.uniform(-1, 1, (12, 3)) * [0.05, 0.04, 0.1],
)
BINS, CELLS = 16, 16


def estimator(kind: type[CropEstimator]) -> CropEstimator:
    """Without a network, which these tests play themselves."""
    return kind.__new__(kind)


def off(pose: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Degrees and millimetres."""
    turn = np.degrees(rotation_angle(true[:3, :3].T @ pose[:3, :3]))
    return float(turn), float(1e3 * np.linalg.norm(pose[:3, 3] - true[:3, 3]))


def crop_around(pose: np.ndarray) -> Crop:
    u, v, z = K @ pose[:3, 3]
    return Crop(u / z + 5, v / z - 7, 1.2 * 572 * 0.25 / z)


def ellipsoid(pose: np.ndarray, crop: Crop) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates in the box that each cell's ray meets on an ellipsoid in it, and whether."""
    axis = (np.arange(CELLS) + 0.5) / CELLS - 0.5
    u, v = np.meshgrid(axis, axis)
    pixels = crop.to_image(np.stack([u, v], axis=-1))
    rays = np.concatenate([pixels, np.ones((CELLS, CELLS, 1))], axis=-1) @ np.linalg.inv(K).T
    R, t, radius = pose[:3, :3], pose[:3, 3], TRAINED.size / 2
    d, o = rays @ R / radius, -(R.T @ t) / radius
    a, b, c = (d * d).sum(-1), (d * o).sum(-1), o @ o - 1
    under = b * b - a * c
    hit = under > 0
    depth = (-b - np.sqrt(np.where(hit, under, 0.0))) / a
    return np.moveaxis((o + depth[..., None] * d) / 2 + 0.5, -1, 0), hit


def said_of(coordinates: np.ndarray, shown: np.ndarray) -> np.ndarray:
    """Logits that mean just these coordinates, shared by the two nearest bins."""
    place = np.clip(coordinates, 0, 1) * (BINS - 1)
    lower = np.clip(np.floor(place), 0, BINS - 2).astype(int)
    weight = np.full((3, BINS, CELLS, CELLS), 1e-9)
    for k, share in ((0, 1 - (place - lower)), (1, place - lower)):
        np.put_along_axis(weight, (lower + k)[:, None], share[:, None] + 1e-9, axis=1)
    mask = np.where(shown, 8.0, -8.0)[None]
    return np.concatenate([np.log(weight).reshape(-1, CELLS, CELLS), mask])


@pytest.mark.parametrize("seed", range(5))
def test_exact_coordinates_give_the_exact_pose(seed: int) -> None:
    pose = random_poses(1, seed, depth_m=0.8)[0]
    crop = crop_around(pose)
    found = estimator(DenseEstimator).solve([said_of(*ellipsoid(pose, crop))], crop, K, TRAINED)
    assert found is not None
    turn, shift = off(found[0], pose)
    assert turn < 0.1 and shift < 1.0 and found[1] > 0.9


@pytest.mark.parametrize("seed", range(5))
def test_half_of_the_cells_may_be_wrong(seed: int) -> None:
    pose = random_poses(1, seed, depth_m=0.8)[0]
    crop = crop_around(pose)
    coordinates, shown = ellipsoid(pose, crop)
    rng = np.random.default_rng(seed)
    wrong = rng.random(shown.shape) < 0.5
    coordinates[:, wrong] = rng.random((3, int(wrong.sum())))
    found = estimator(DenseEstimator).solve([said_of(coordinates, shown)], crop, K, TRAINED)
    assert found is not None
    turn, shift = off(found[0], pose)
    assert turn < 4.0 and shift < 10.0
    # The score says how many are.
    assert abs(found[1] - 1 + (wrong & shown).sum() / shown.sum()) < 0.15


def test_nothing_shown_is_nothing_found() -> None:
    crop = Crop(320.0, 240.0, 100.0)
    nothing = said_of(np.zeros((3, CELLS, CELLS)), np.zeros((CELLS, CELLS), dtype=bool))
    assert estimator(DenseEstimator).solve([nothing], crop, K, TRAINED) is None


def test_a_cell_of_two_minds_takes_the_likelier_not_the_middle() -> None:
    logits = np.full((3, BINS, 1), -20.0)
    logits[:, 2], logits[:, 13] = 0.0, -0.1
    np.testing.assert_allclose(expected_coordinates(logits), 2 / (BINS - 1), atol=1e-6)


def test_the_last_bin_counts_once() -> None:
    logits = np.full((3, BINS, 2), -20.0)
    logits[:, 0, 0] = logits[:, BINS - 1, 1] = 0.0
    np.testing.assert_allclose(expected_coordinates(logits)[0], [0.0, 1.0], atol=1e-6)


@pytest.mark.parametrize("seed", range(5))
def test_direct_says_what_crop_terms_mean(seed: int) -> None:
    pose = random_poses(1, seed, depth_m=0.8)[0]
    crop = crop_around(pose)
    rotation, site = crop.encode_pose(pose, K, TRAINED.diameter_m)
    # Of any length, and the second row not quite at right angles.
    second = 0.7 * rotation[1] + 0.2 * rotation[0]
    answer = np.concatenate([3 * rotation[0], second, site])
    drawn = np.full((4, CELLS, CELLS), 2.0)
    found = estimator(DirectEstimator).solve([answer, drawn], crop, K, TRAINED)
    assert found is not None
    np.testing.assert_allclose(found[0], pose, atol=1e-9)
    assert found[1] == pytest.approx(1 / (1 + np.exp(-2.0)))


def heat(places: np.ndarray, cells: int = 32) -> np.ndarray:
    """Logits of a bump about each place."""
    centre = (places + 0.5) * cells - 0.5
    axis = np.arange(cells)
    x, y = (axis - centre[:, :1]) ** 2, (axis - centre[:, 1:]) ** 2
    return -0.5 * (x[:, None, :] + y[:, :, None])


def test_peaks_are_found_between_cells() -> None:
    places = np.random.default_rng(1).uniform(-0.4, 0.4, (20, 2))
    found, sure = heat_map_peaks(heat(places))
    np.testing.assert_allclose(found, places, atol=0.1 / 32)
    assert (sure > 0.9).all()
    _, flat = heat_map_peaks(np.zeros((1, 32, 32)))
    assert flat[0] < 0.03


@pytest.mark.parametrize("seed", range(5))
def test_a_third_of_the_keypoints_may_be_wrong(seed: int) -> None:
    pose = random_poses(1, seed, depth_m=0.8)[0]
    crop = crop_around(pose)
    pixels = transform_points(pose, TRAINED.keypoints) @ K.T
    places = crop.from_image(pixels[:, :2] / pixels[:, 2:])
    solver = estimator(KeypointEstimator)
    found = solver.solve([heat(places)], crop, K, TRAINED)
    assert found is not None
    turn, shift = off(found[0], pose)
    assert turn < 2.0 and shift < 10.0
    places[:4] = np.random.default_rng(seed).uniform(-0.45, 0.45, (4, 2))
    found_again = solver.solve([heat(places)], crop, K, TRAINED)
    assert found_again is not None
    turn, shift = off(found_again[0], pose)
    assert turn < 6.0 and shift < 25.0
    assert found_again[1] < found[1] - 0.15


def test_points_that_are_too_few_or_agree_with_nothing() -> None:
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (40, 3))
    pixels = np.random.default_rng(1).uniform(0, 480, (40, 2))
    assert pose_from_points(pixels[:3], points[:3], K, 2.0) is None
    found = pose_from_points(pixels, points, K, 0.01)
    assert found is None or found[1].sum() < 8
