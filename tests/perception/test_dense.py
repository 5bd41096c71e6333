"""The estimator ``dense``: from logits of object coordinates to a pose."""

from __future__ import annotations

import numpy as np
import pytest

from decoders import (
    BINS,
    CELLS,
    TRAINED,
    K,
    crop_around,
    ellipsoid,
    estimator,
    logits_of,
    off,
)
from graspcast.perception.crops import Crop
from graspcast.perception.dense import DenseEstimator, expected_coordinates
from poses import random_poses


@pytest.mark.parametrize("seed", range(5))
def test_exact_coordinates_give_the_exact_pose(seed: int) -> None:
    pose = random_poses(1, seed, depth_m=0.8)[0]
    crop = crop_around(pose)
    found = estimator(DenseEstimator).solve([logits_of(*ellipsoid(pose, crop))], crop, K, TRAINED)
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
    found = estimator(DenseEstimator).solve([logits_of(coordinates, shown)], crop, K, TRAINED)
    assert found is not None
    turn, shift = off(found[0], pose)
    assert turn < 4.0 and shift < 10.0
    # The score says how many are.
    assert abs(found[1] - 1 + (wrong & shown).sum() / shown.sum()) < 0.15


def test_nothing_shown_is_nothing_found() -> None:
    crop = Crop(320.0, 240.0, 100.0)
    nothing = logits_of(np.zeros((3, CELLS, CELLS)), np.zeros((CELLS, CELLS), dtype=bool))
    assert estimator(DenseEstimator).solve([nothing], crop, K, TRAINED) is None


def test_a_cell_of_two_minds_takes_the_likelier_not_the_middle() -> None:
    logits = np.full((3, BINS, 1), -20.0)
    logits[:, 2], logits[:, 13] = 0.0, -0.1
    np.testing.assert_allclose(expected_coordinates(logits), 2 / (BINS - 1), atol=1e-6)


def test_the_last_bin_counts_once() -> None:
    logits = np.full((3, BINS, 2), -20.0)
    logits[:, 0, 0] = logits[:, BINS - 1, 1] = 0.0
    np.testing.assert_allclose(expected_coordinates(logits)[0], [0.0, 1.0], atol=1e-6)


def test_coordinates_that_no_pose_explains_are_nothing_found() -> None:
    shown = np.zeros((CELLS, CELLS), dtype=bool)
    shown[:2, :2] = True
    logits = logits_of(np.full((3, CELLS, CELLS), 0.5), shown)  # one and the same point
    crop = Crop(320.0, 240.0, 100.0)
    assert estimator(DenseEstimator).solve([logits], crop, K, TRAINED) is None
