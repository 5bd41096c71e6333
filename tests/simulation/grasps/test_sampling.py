from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.simulation.grasps.sampling import LabelledTrials, StratifiedSample


def _trials(successes: int, near: int, far: int) -> LabelledTrials:
    poses = np.tile(np.eye(4), (successes + near + far, 1, 1))
    poses[successes + near :, 0, 3] = 1.0
    return LabelledTrials(poses, np.arange(len(poses)) < successes)


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
