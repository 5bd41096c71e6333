"""The best threshold against brute force, and its properties."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.evaluation.best_threshold import Trials, best_threshold, on_other_scenes
from graspcast.evaluation.net_benefit import Costs

costs = st.builds(Costs, st.floats(0, 20), st.floats(0, 5), st.floats(0, 1))
seeds = st.integers(0, 10_000)


def random_trials(seed: int, *, n: int = 30, looks: int = 3, outcomes: bool = True) -> Trials:
    """Coarse forecasts, so that there are ties, some missing."""
    rng = np.random.default_rng(seed)
    probability = rng.integers(0, 21, (n, looks)) / 20
    probability[rng.random((n, looks)) < 0.2] = np.nan
    success = (rng.random((n, looks)) < np.nan_to_num(probability)).astype(float)
    return Trials(
        probability=probability,
        success=success if outcomes else None,
        looks=np.broadcast_to(np.arange(1, looks + 1), (n, looks)),
        ended=rng.integers(1, looks + 1, n),
        scenes=np.array([f"d/{i % 5}" for i in range(n)]),
    )


def by_hand(trials: Trials, threshold: float, price: Costs) -> float:
    """Walk through each instance, look by look."""
    total = 0.0
    for i, row in enumerate(trials.probability.tolist()):
        for k, p in enumerate(row):
            if p >= threshold:  # never where it is NaN
                held = p if trials.success is None else trials.success[i, k]
                total += held - (1 - held) * price.failure - k * price.look
                break
        else:
            total -= price.abstention + (trials.ended[i] - 1) * price.look
    return total / len(trials.probability)


@pytest.mark.slow
@given(seeds, costs, st.booleans())
def test_it_is_the_best_of_all_by_brute_force(seed: int, price: Costs, outcomes: bool) -> None:
    trials = random_trials(seed, outcomes=outcomes)
    threshold, value = best_threshold(trials, price)
    every = [*(np.arange(0, 1001) / 1000).tolist(), 2.0]
    assert value == pytest.approx(max(by_hand(trials, t, price) for t in every))
    at = 2.0 if threshold is None else threshold
    assert by_hand(trials, at, price) == pytest.approx(value)


@given(seeds, costs, st.floats(0, 1))
def test_the_net_benefit_at_a_threshold_is_that_by_hand(
    seed: int, price: Costs, threshold: float
) -> None:
    trials = random_trials(seed)
    found = trials.net_benefit(threshold, price).mean()
    assert found == pytest.approx(by_hand(trials, threshold, price))


@pytest.mark.slow
@given(seeds, costs, st.floats(0.05, 1))
def test_with_a_limit_it_is_the_best_up_to_there(seed: int, price: Costs, most: float) -> None:
    trials = random_trials(seed)
    threshold, value = best_threshold(trials, price, most=most)
    assert threshold is not None and threshold <= most
    every = [t for t in (np.arange(0, 1001) / 1000).tolist() if t <= most] + [most]
    assert value == pytest.approx(max(by_hand(trials, t, price) for t in every))


@given(seeds, costs, st.floats(0, 5))
def test_dearer_failures_never_lower_it_and_dearer_skips_never_raise_it(
    seed: int, price: Costs, more: float
) -> None:
    trials = random_trials(seed, looks=1)

    def chosen(costs: Costs) -> float:
        threshold, _ = best_threshold(trials, costs)
        # Thresholds between the same forecasts do the same.
        return float((trials.probability >= (2.0 if threshold is None else threshold)).sum())

    dearer_failure = Costs(price.failure + more, price.abstention, price.look)
    dearer_skip = Costs(price.failure, price.abstention + more, price.look)
    assert chosen(dearer_failure) <= chosen(price) <= chosen(dearer_skip)


@given(seeds, costs)
def test_dearer_outcomes_never_raise_the_net_benefit(seed: int, price: Costs) -> None:
    trials = random_trials(seed)
    _, value = best_threshold(trials, price)
    for dearer in (
        Costs(price.failure + 1, price.abstention, price.look),
        Costs(price.failure, price.abstention + 1, price.look),
        Costs(price.failure, price.abstention, price.look + 1),
    ):
        assert best_threshold(trials, dearer)[1] <= value + 1e-9


def test_without_a_forecast_nothing_is_attempted() -> None:
    trials = Trials.of_one_look(np.full(3, np.nan), np.zeros(3), np.array(["d/1"] * 3))
    assert best_threshold(trials, Costs(1.0, 0.5)) == (None, -0.5)


def test_it_is_written_as_shortly_as_makes_no_difference() -> None:
    p = np.array([0.734567, 0.7329, 0.2])
    trials = Trials.of_one_look(p, np.array([1.0, 0.0, 0.0]), np.array(["d/1"] * 3))
    threshold, value = best_threshold(trials, Costs(2.0, 0.0))
    assert threshold == 0.734
    assert value == pytest.approx(1 / 3)


def test_of_equal_thresholds_the_strictest_is_taken() -> None:
    # A success and a failure that cancel out below the first success.
    p = np.array([0.9, 0.5, 0.4])
    trials = Trials.of_one_look(p, np.array([1.0, 0.0, 1.0]), np.array(["d/1"] * 3))
    assert best_threshold(trials, Costs(1.0, 0.0))[0] == 0.9


def test_other_scenes_choose_and_are_less_good_than_the_own() -> None:
    rng = np.random.default_rng(0)
    price, gaps = Costs(1.0, 0.0), []
    for _ in range(50):
        # Forecasts that say nothing: whatever is chosen is chance.
        p = rng.random(60)
        trials = Trials.of_one_look(
            p, rng.random(60) < 0.5, np.repeat(np.arange(12), 5).astype(str)
        )
        own = best_threshold(trials, price)[1]
        others = float(on_other_scenes(trials, price, None, 0).mean())
        gaps.append(own - others)
        assert own >= -1e-12
    assert np.mean(gaps) > 0.03
