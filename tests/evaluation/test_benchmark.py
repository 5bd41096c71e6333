"""The benchmark data."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import synthetic
from graspcast.errors import InputError, MismatchError
from graspcast.evaluation.benchmark import Benchmark, _true_poses
from graspcast.evaluation.methods import (
    Majority,
)
from graspcast.evaluation.protocols import forecast
from graspcast.evaluation.scores import score
from graspcast.paper.dataset import ESTIMATORS, GRIPPERS, Published


def test_tried_instances_among_some_rows() -> None:
    benchmark = synthetic.benchmark({})
    rows = np.arange(len(benchmark)) % 4 == 1
    tried = benchmark.tried("b", "u", rows)
    assert_array_equal(tried.estimates.im_id, benchmark.estimates.im_id[rows])
    assert_array_equal(benchmark.rows_of(tried.estimates), np.flatnonzero(rows))
    table = benchmark.outcomes.filter(estimator="b", gripper="u").sort("im_id")
    assert_array_equal(tried.own_success, table["success"].to_numpy()[rows])
    assert not tried.has_truth.any()
    own = benchmark.tried("b", "u", rows, simulated=True)
    assert (own.own_success != tried.own_success).any()


def test_simulated_outcomes_in_place_of_the_published() -> None:
    benchmark = synthetic.benchmark({})
    every = np.full(len(benchmark), True)
    replaced = benchmark.with_simulated_outcomes().tried("a", "p", every)
    assert_array_equal(
        replaced.own_success, benchmark.tried("a", "p", every, simulated=True).own_success
    )
    with pytest.raises(InputError, match="outcomes of your own simulated trials are needed"):
        synthetic.benchmark({}, simulated=False).with_simulated_outcomes()


def test_the_digest_covers_what_a_prediction_depends_on() -> None:
    benchmark = synthetic.benchmark({})
    fewer = dataclasses.replace(benchmark, outcomes=benchmark.outcomes[1:], _joined={})
    without = synthetic.benchmark({}, simulated=False)
    digest = benchmark.digest(own_trials=False)
    assert len({digest, benchmark.digest(own_trials=True), fewer.digest(own_trials=False)}) == 3
    assert without.digest(own_trials=False) == digest
    assert without.digest(own_trials=True) == digest


def test_an_instance_without_ground_truth_is_named(data: Published) -> None:
    benchmark = Benchmark.of(data)
    elsewhere = dataclasses.replace(benchmark.estimates, im_id=benchmark.estimates.im_id + 100_000)
    with pytest.raises(MismatchError, match="3152 instances have no ground truth"):
        _true_poses(elsewhere, data.bop)


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
