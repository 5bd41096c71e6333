"""PnP with RANSAC."""

from __future__ import annotations

import numpy as np

from decoders import K
from graspcast.perception.pnp import pose_from_points


def test_points_that_are_too_few_or_agree_with_nothing() -> None:
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (40, 3))
    pixels = np.random.default_rng(1).uniform(0, 480, (40, 2))
    assert pose_from_points(pixels[:3], points[:3], K, 2.0) is None
    found = pose_from_points(pixels, points, K, 0.01)
    assert found is None or found[1].sum() < 8
