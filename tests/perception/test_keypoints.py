"""The estimator ``keypoints``: from heat maps to a pose."""

from __future__ import annotations

import numpy as np
import pytest

from decoders import TRAINED, K, crop_around, estimator, heat, off
from graspcast.perception.keypoints import KeypointEstimator, heat_map_peaks
from graspcast.pose.transforms import transform_points
from poses import random_poses


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
