"""What is expected after a further look."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.forecasting.look_again import expected_after, looks_for
from graspcast.views.camera_motion import CameraNoise
from graspcast.views.statistics import fusion_statistics
from looked_at import Training, fused, trained, training


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Training:
    return training(tmp_path_factory.mktemp("given"))


@pytest.fixture(scope="module")
def forecaster(tmp_path_factory: pytest.TempPathFactory):  # type: ignore[no-untyped-def]
    with pytest.warns(match="not calibrated"):
        return trained(tmp_path_factory.mktemp("trained"))[0]


def test_expectation_agrees_with_what_the_next_look_brings(given: Training, forecaster) -> None:  # type: ignore[no-untyped-def]
    one = fused(given.results, given.models, given.motion, 1)
    two = fused(given.results, given.models, given.motion, 2)
    rows = np.arange(len(one))
    looks = looks_for(forecaster, one, rows, fusion_statistics(one), world=given.motion.world_T_cam)
    expected = np.array([look.expected_probability for look in looks])
    after = forecaster.judge(two, given.models, guide="fused")
    found = np.array([row.verdict.probability for row in after])
    now = [r.verdict.probability for r in forecaster.judge(one, given.models)]
    assert abs(expected.mean() - found.mean()) < 0.12
    assert expected.mean() > np.mean(now) + 0.1


def test_looking_along_the_same_ray_brings_less_than_across_it(given: Training, forecaster) -> None:  # type: ignore[no-untyped-def]
    one = fused(given.results, given.models, given.motion, 1)
    rows, statistics = np.arange(len(one)), fusion_statistics(one)
    ray = one.poses.cam_T_obj[:, :3, 3]
    back = -ray / np.linalg.norm(ray, axis=1, keepdims=True)
    side = np.cross(back, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    along, across = (expected_after(forecaster, one, rows, statistics, d) for d in (back, side))
    assert across.mean() > along.mean() + 0.05
    noisy = expected_after(forecaster, one, rows, statistics, side, noise=CameraNoise(0.02, 0.02))
    assert noisy.mean() < across.mean()
    some = rows[5:9]
    alone = expected_after(forecaster, one, some, statistics[some], side[some])
    np.testing.assert_allclose(alone, across[some])
