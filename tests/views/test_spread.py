"""Spreads of estimators, learned from known poses."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import InstanceKey, Instances
from graspcast.pose.ray_frame import displaced
from graspcast.views.spread import DEFAULT_SPREAD, Spread, Spreads, learn_spreads
from poses import random_poses
from static_scenes import scattered

N = 2000


def estimates(poses: np.ndarray) -> Estimates:
    keys = [InstanceKey("d", 1, i, 1 + i % 2, 0) for i in range(poses.shape[1])]
    return Estimates(("a", "b")[: len(poses)], Instances.of(keys), poses)


def test_spreads_of_known_size_are_found() -> None:
    true = random_poses(N)
    poses = np.stack(
        [scattered(true, 1, (0.002, 0.010, 0.05)), scattered(true, 2, (0.004, 0.015, 0.1))]
    )
    poses[0, :200, :3, 3] *= 1.4  # gross errors do not enter
    found = learn_spreads(estimates(poses), true)
    a, b = found.of("a", "d-1"), found.of("b", "d-2")
    assert (a.across, a.along, a.rotation_rad) == pytest.approx((0.002, 0.010, 0.05), rel=0.2)
    assert (b.across, b.along, b.rotation_rad) == pytest.approx((0.004, 0.015, 0.1), rel=0.2)
    assert a.shared < 0.1


def test_the_shared_part_is_found() -> None:
    true = random_poses(N)
    rng = np.random.default_rng(0)
    size = np.array([0.003, 0.003, 0.012, 0.07, 0.07, 0.07])
    common, own = rng.normal(size=(1, N, 6)), rng.normal(size=(2, N, 6))
    poses = displaced(true, (np.sqrt(0.7) * common + np.sqrt(0.3) * own) * size)
    assert learn_spreads(estimates(poses), true).of("a", "d-1").shared == pytest.approx(
        0.7, abs=0.07
    )


def test_unknown_estimators_have_the_default_and_rare_objects_their_estimators() -> None:
    true = random_poses(N)
    given = estimates(scattered(true, 1)[None])
    found = learn_spreads(given, true, least=N)
    assert found.of("other", "d-1") == DEFAULT_SPREAD
    assert not found.by_object
    assert found.of("a", "d-1") == found.by_estimator["a"]
    table = Spreads().table(("a", "b"), np.array(["d-1", "d-2", "d-1"]))
    assert table.shape == (3, 2, 4) and (table == table[0, 0]).all()


def test_too_few_known_poses_and_wrong_spreads_are_refused() -> None:
    true = random_poses(40)
    true[20:] = np.nan
    with pytest.raises(InputError, match="at least 30 instances with known poses, but 20 of 40"):
        learn_spreads(estimates(random_poses(40)[None]), true)
    for sizes in ((0.0, 0.1, 0.1, 0.5), (0.1, 0.1, float("nan"), 0.5), (0.1, 0.1, 0.1, 2.0)):
        with pytest.raises(InputError, match="should be positive"):
            Spread(*sizes)
