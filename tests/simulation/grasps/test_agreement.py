from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import accuracy_score, cohen_kappa_score

from graspcast.errors import InputError
from graspcast.simulation.grasps.agreement import agreement

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
