"""One trial of each unit: which one is drawn, and how often."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.guarantees.certify import certify
from graspcast.guarantees.threshold_sequence import ThresholdSequence
from graspcast.guarantees.unit_draws import UnitDraws, UnitShares, Weight
from worlds import ASKED


def at(threshold: float) -> ThresholdSequence:
    """The sequence of a single threshold."""
    return ThresholdSequence((threshold,), (1.0,), "the test")


def test_each_weight_draws_what_it_says() -> None:
    # Every unit: one attempt that holds, three trials that are not attempted (and fail).
    m = 400
    probability = np.tile([0.95, 0.1, 0.1, 0.1], m)
    success = np.tile([True, False, False, False], m)
    units = np.repeat(np.arange(m), 4)
    every = certify(probability, success, units, sequence=at(0.9), weight="unit", **ASKED).overall
    some = certify(probability, success, units, sequence=at(0.9), **ASKED).overall
    assert (every.drawn_attempts, every.drawn_successes) == (m, m)
    assert some.drawn_attempts == some.drawn_successes
    assert abs(some.drawn_attempts - m / 4) < 4 * math.sqrt(m * 3 / 16)
    for guarantee in (every, some):
        assert guarantee.attempt_rate == pytest.approx(0.25)
        low, high = guarantee.attempt_rate_interval
        assert low < 0.25 < high


@pytest.mark.parametrize("weight", ["attempt", "unit"])
def test_a_seed_favours_no_rank_of_probability(weight: Weight) -> None:
    # In each unit the more probable of two attempts holds. Over many data with one seed, the drawn
    # ones are to be binomial: of the right mean, and not the same ones every time.
    rng = np.random.default_rng(0)
    held = []
    for _ in range(300):
        probability = np.sort(rng.uniform(0.95, 1.0, (40, 2)), axis=1).ravel()
        success = np.tile([False, True], 40)
        found = certify(
            probability, success, np.arange(80) // 2, sequence=at(0.9), weight=weight, **ASKED
        ).overall
        assert found.drawn_attempts == 40
        held.append(found.drawn_successes)
    assert abs(np.mean(held) - 20) < 3 * math.sqrt(10 / 300)
    assert 7 < np.var(held) < 13


@given(st.integers(0, 1000), st.sampled_from([0.0, 0.3, 0.7, 1.0]))
def test_shares_are_those_of_a_loop_over_units(seed: int, threshold: float) -> None:
    rng = np.random.default_rng(seed)
    number = np.sort(np.r_[np.arange(6), rng.integers(6, size=20)])
    probability, success = rng.random(26).round(1), rng.random(26) < 0.5
    shares = UnitShares.at(threshold, probability, success, number)
    largest = max(np.sum(number == unit) for unit in range(6))
    for unit in range(6):
        mine = number == unit
        attempt = mine & (probability >= threshold)
        assert shares.attempted[unit] == pytest.approx(attempt.sum() / mine.sum())
        assert shares.size[unit] == pytest.approx(mine.sum() / largest)
        if attempt.any():
            assert shares.succeeded[unit] == pytest.approx(success[attempt].mean())
        else:
            assert np.isnan(shares.succeeded[unit])


@pytest.mark.parametrize("weight", ["attempt", "unit"])
def test_draws_are_on_average_as_expected(weight: Weight) -> None:
    rng = np.random.default_rng(0)
    number = np.repeat(np.arange(30), rng.integers(1, 5, size=30))
    probability, success = rng.random(len(number)), rng.random(len(number)) < 0.6
    share, success_rate = UnitShares.at(0.4, probability, success, number).expected_draws(weight)
    counts = np.array(
        [UnitDraws(probability, success, number, weight, seed).count(0.4) for seed in range(400)]
    )
    assert counts[:, 0].mean() == pytest.approx(30 * share, rel=0.05)
    assert counts[:, 1].sum() / counts[:, 0].sum() == pytest.approx(success_rate, abs=0.02)


def test_without_attempts_nothing_is_drawn() -> None:
    data = np.array([0.1, 0.2]), np.array([True, False]), np.array([0, 1])
    for weight in ("attempt", "unit"):
        assert UnitDraws(*data, weight, 0).count(0.5) == (0, 0)
        share, success_rate = UnitShares.at(0.5, *data).expected_draws(weight)
        assert share == 0
        assert math.isnan(success_rate)
