from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import accuracy_score, cohen_kappa_score

from graspcast.errors import InputError
from graspcast.simulation.grasps.agreement import agreement
from graspcast.simulation.grasps.sampling import FittedTrials, StratifiedSample

pairs = st.lists(st.tuples(st.booleans(), st.booleans()), min_size=2, max_size=60)


@given(pairs, st.integers(0, 1000))
def test_like_scikit_learn(rows: list[tuple[bool, bool]], seed: int) -> None:
    a, b = np.array(rows).T
    w = np.random.default_rng(seed).uniform(0.1, 3.0, len(a))
    for weights in (None, w):
        found = agreement(a, b, weights)
        assert found.accuracy == pytest.approx(accuracy_score(b, a, sample_weight=weights))
        if len({*a.tolist(), *b.tolist()}) == 2:
            expected = cohen_kappa_score(a, b, sample_weight=weights)
            assert found.kappa == pytest.approx(expected, abs=1e-9)
        else:
            assert found.kappa == 0.0


def test_majority_rates_and_error() -> None:
    found = agreement(np.array([1, 1, 0, 0, 0], bool), np.array([1, 1, 1, 1, 0], bool))
    assert (found.n, found.majority, found.given_rate, found.simulated_rate) == (5, 0.8, 0.8, 0.4)
    assert found.standard_error == pytest.approx(np.sqrt(0.6 * 0.4 / 5))
    with pytest.raises(InputError, match="no trials"):
        agreement(np.array([], bool), np.array([], bool))


def _trials(successes: int, near: int, far: int) -> FittedTrials:
    poses = np.tile(np.eye(4), (successes + near + far, 1, 1))
    poses[successes + near :, 0, 3] = 1.0
    return FittedTrials(poses, np.arange(len(poses)) < successes)


@given(st.integers(0, 50), st.integers(0, 50), st.integers(0, 50), st.integers(1, 120))
def test_a_sample_stands_for_all(successes: int, near: int, far: int, count: int) -> None:
    trials = _trials(successes, near, far)
    sample = StratifiedSample(trials, np.random.default_rng(0))
    rows, weights = sample.take(count)
    assert len(set(rows.tolist())) == len(rows) == min(count, len(trials))
    if len(rows) == len(trials):
        assert np.all(weights == 1.0)
    more, _ = sample.take(count + 10)
    assert set(rows.tolist()) <= set(more.tolist())
    # What each kind of trial stands for is its number, as soon as it is in the sample at all.
    chosen = trials.success[rows]
    if chosen.any():
        assert weights[chosen].sum() == pytest.approx(successes)
