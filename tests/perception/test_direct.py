"""The estimator ``direct``: from regressed numbers to a pose."""

from __future__ import annotations

import numpy as np
import pytest

from decoders import CELLS, TRAINED, K, crop_around, estimator
from graspcast.perception.direct import DirectEstimator
from poses import random_poses


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
