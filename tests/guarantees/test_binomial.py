"""Exact binomial statements, against SciPy's own and against counting."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from graspcast.guarantees.binomial import lower_bound, mean_interval, needed_trials, p_value, power


@given(st.integers(1, 300), st.data())
def test_bounds_and_tests_are_scipys(n: int, data: st.DataObject) -> None:
    held = data.draw(st.integers(0, n))
    rate = data.draw(st.floats(0.05, 0.99))
    test = binomtest(held, n, rate, alternative="greater")
    assert p_value(held, n, rate) == pytest.approx(test.pvalue, rel=1e-9, abs=1e-300)
    low = test.proportion_ci(0.9, method="exact").low
    assert lower_bound(held, n, 0.9) == pytest.approx(low, abs=1e-9)


@given(st.integers(1, 200), st.data())
def test_the_test_passes_where_the_bound_reaches_the_rate(n: int, data: st.DataObject) -> None:
    held = data.draw(st.integers(0, n))
    bound = lower_bound(held, n, 0.9)
    for rate in (bound - 1e-6, bound + 1e-6):
        if 0 < rate < 1:
            assert (p_value(held, n, rate) <= 0.1) is (rate < bound)


def test_no_trials_show_nothing() -> None:
    assert p_value(0, 0, 0.9) == 1.0
    assert lower_bound(0, 0, 0.9) == 0.0
    assert power(0, 1.0, rate=0.9, confidence=0.9) == 0.0


@pytest.mark.parametrize("true_rate", [0.85, 0.93, 0.99])
def test_power_is_the_chance_of_an_outcome_that_passes(true_rate: float) -> None:
    n = 80
    held = np.arange(n + 1)
    passes = np.array([p_value(int(h), n, 0.9) <= 0.1 for h in held])
    expected = binom.pmf(held, n, true_rate)[passes].sum()
    assert power(n, true_rate, rate=0.9, confidence=0.9) == pytest.approx(expected)


@pytest.mark.parametrize("observed", [1.0, 0.99, 0.97, 0.95, 0.92])
def test_needed_trials_are_the_fewest(observed: float) -> None:
    found = needed_trials(observed, rate=0.9, confidence=0.9)
    assert found is not None

    def enough(n: int) -> bool:
        return p_value(n - math.ceil((1 - observed) * n - 1e-9), n, 0.9) <= 0.1

    assert enough(found)
    assert not any(enough(n) for n in range(1, found))


def test_needed_trials_where_all_succeed_and_where_none_would_do() -> None:
    assert needed_trials(1.0, rate=0.9, confidence=0.9) == 22  # 0.9 ** 22 < 0.1 < 0.9 ** 21
    assert needed_trials(0.9, rate=0.9, confidence=0.9) is None
    assert needed_trials(0.5, rate=0.9, confidence=0.9) is None
    assert needed_trials(0.91, rate=0.9, confidence=0.9, max_trials=50) is None


def test_an_interval_of_zeros_and_ones_is_clopper_pearsons() -> None:
    values = np.repeat([0.0, 1.0], [30, 12])
    found = binomtest(12, 42).proportion_ci(0.9, method="exact")
    assert mean_interval(values, 0.9) == pytest.approx((found.low, found.high))


@pytest.mark.parametrize("spread", [0.3, 1.0, 30.0])
def test_intervals_of_fractions_cover_their_mean(spread: float) -> None:
    rng = np.random.default_rng(0)
    missed = 0
    for _ in range(500):
        low, high = mean_interval(rng.beta(0.3 * spread, 0.7 * spread, 40), 0.9)
        missed += not low <= 0.3 <= high
    assert missed <= 50 + 3 * math.sqrt(45)
    assert mean_interval(np.zeros(5), 0.9)[0] == 0.0
    assert mean_interval(np.ones(5), 0.9)[1] == 1.0


@pytest.mark.parametrize("total", [0.4, 3.0, 12.4, 39.7])
def test_an_interval_of_fractions_has_tails_smaller_by_e(total: float) -> None:
    """The tails of the binomial distributions with the ends as their rates, counts rounded."""
    n = 40
    low, high = mean_interval(np.full(n, total / n), 0.9)
    tail = 0.05 / math.e
    if total >= 1:
        assert binom.sf(math.floor(total) - 1, n, low) == pytest.approx(tail)
    else:
        assert low == 0.0
    if total <= n - 1:
        assert binom.cdf(math.ceil(total), n, high) == pytest.approx(tail)
    else:
        assert high == 1.0


def test_power_of_few_trials() -> None:
    # One success is enough for a rate of 0.05: it had a probability of 0.05 or less.
    assert power(1, 0.3, rate=0.05, confidence=0.9) == pytest.approx(0.3)
    assert power(1, 0.3, rate=0.2, confidence=0.9) == 0.0
    assert power(2, 0.3, rate=0.3, confidence=0.9) == pytest.approx(0.3**2)
    assert power(22, 0.95, rate=0.9, confidence=0.9) == pytest.approx(0.95**22)
    assert power(21, 0.95, rate=0.9, confidence=0.9) == 0.0


@pytest.mark.parametrize("confidence", [0.8, 0.95])
@pytest.mark.parametrize("observed", [0.93, 0.92, 0.915, 0.9113])
def test_needed_trials_are_the_fewest_also_if_many(observed: float, confidence: float) -> None:
    trials = np.arange(1, 10_001)
    failures = np.ceil((1 - observed) * trials - 1e-9)
    enough = trials[binom.cdf(failures, trials, 1 - 0.9) <= 1 - confidence]
    fewest = int(enough[0])
    asked = {"rate": 0.9, "confidence": confidence}
    assert needed_trials(observed, **asked) == fewest
    assert needed_trials(observed, **asked, max_trials=fewest) == fewest
    assert needed_trials(observed, **asked, max_trials=fewest - 1) is None


@pytest.mark.parametrize("needed", [1, 255, 256, 257, 1023, 1024, 1025])
def test_needed_trials_where_all_succeed_whatever_their_number(needed: int) -> None:
    """The rate that so many successes just show: rate ** needed is 0.1."""
    rate = 0.1 ** (1 / needed) - 1e-9
    asked = {"rate": rate, "confidence": 0.9}
    assert needed_trials(1.0, **asked) == needed
    assert needed_trials(1.0, **asked, max_trials=needed) == needed
    assert needed_trials(1.0, **asked, max_trials=needed - 1) is None


def test_more_trials_than_the_default_limit_are_too_many() -> None:
    rate = 0.1 ** (1 / 10_000) - 1e-12
    assert needed_trials(1.0, rate=rate, confidence=0.9) == 10_000
    rate = 0.1 ** (1 / 10_001) - 1e-12
    assert needed_trials(1.0, rate=rate, confidence=0.9) is None
