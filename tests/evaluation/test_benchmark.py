"""The benchmark data."""

from __future__ import annotations

import numpy as np
import pytest

import synthetic
from graspcast.errors import MismatchError
from graspcast.evaluation.benchmark import Benchmark, _true_poses
from graspcast.evaluation.methods import (
    Majority,
)
from graspcast.evaluation.protocols import forecast
from graspcast.evaluation.scores import score
from graspcast.paper.dataset import ESTIMATORS, GRIPPERS, Published


@pytest.mark.slow
def test_an_instance_without_ground_truth_is_named(data: Published) -> None:
    benchmark = Benchmark.of(data)
    elsewhere = synthetic.with_keys(benchmark.estimates, im_id=benchmark.estimates.im_id + 100_000)
    with pytest.raises(MismatchError, match="3152 instances have no ground truth"):
        _true_poses(elsewhere, data.bop)


@pytest.mark.slow
def test_the_published_benchmark_guessing_the_majority(data: Published) -> None:
    """.755 and .808 on the authors' split, as the paper's tables have it."""
    benchmark = Benchmark.of(data)
    assert benchmark.pairs() == [(e, g) for e in ESTIMATORS for g in GRIPPERS]
    assert 0.25 < benchmark.reported.mean() < 0.4
    for gripper, expected in zip(GRIPPERS, (0.755, 0.808), strict=True):
        accuracy = []
        for principal in ESTIMATORS:
            f = forecast(Majority(), "majority", benchmark, "random_split", principal, gripper)
            accuracy.append(score(f.probability, f.success, f.objects).accuracy)
        assert np.mean(accuracy) == pytest.approx(expected, abs=0.001)
    # The estimates lie near their true poses, so the instances are matched.
    offset = benchmark.estimates.of("zebrapose")[:, :3, 3] - benchmark.truth[:, :3, 3]
    assert np.median(np.linalg.norm(offset, axis=-1)) < 0.02
