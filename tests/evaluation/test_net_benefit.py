"""Net benefit by hand and against decision-curve analysis; its threshold is the best one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.errors import InputError
from graspcast.evaluation.net_benefit import Costs

costs = st.builds(Costs, st.floats(0, 20), st.floats(0, 5))


def test_net_benefit_by_hand() -> None:
    price = Costs(failure=3.0, abstention=1.0)
    assert price.break_even == pytest.approx(0.5)
    probability = np.array([0.9, 0.5, 0.4, 0.1])
    success = np.array([True, False, True, False])
    # Attempts at 0.9 (held), 0.5 (failed); abstains twice.
    assert price.net_benefit_of_forecast(probability, success).tolist() == [1, -3, -1, -1]
    always, never, perfect = price.references(success).values()
    assert always.tolist() == [1, -3, 1, -3]
    assert never.tolist() == [-1, -1, -1, -1]
    assert perfect.tolist() == [1, -1, 1, -1]
    # Where a failure costs less than abstaining, even certain failures are attempted.
    assert Costs(0.5, 1.0).references(success)["perfect"].tolist() == [1, -0.5, 1, -0.5]


@given(st.floats(0.01, 10), st.integers(0, 1000))
def test_with_free_abstention_it_is_the_net_benefit_of_decision_curves(
    failure: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    probability, success = rng.random(50), rng.random(50) < 0.5
    price = Costs(failure, 0.0)
    threshold = price.break_even
    attempt = probability >= threshold
    net_benefit = (attempt & success).mean() - (attempt & ~success).mean() * threshold / (
        1 - threshold
    )
    assert price.net_benefit_of_forecast(probability, success).mean() == pytest.approx(net_benefit)


@given(costs, st.floats(0, 1))
def test_the_break_even_probability_makes_the_better_choice(price: Costs, p: float) -> None:
    attempting, abstaining = p - (1 - p) * price.failure, -price.abstention
    benefit = attempting if p >= price.break_even else abstaining
    assert benefit == pytest.approx(max(attempting, abstaining))


@given(costs, st.integers(0, 1000))
def test_nobody_beats_a_perfect_forecaster(price: Costs, seed: int) -> None:
    rng = np.random.default_rng(seed)
    probability, success = rng.random(20), rng.random(20) < 0.5
    perfect = price.references(success)["perfect"]
    assert (price.net_benefit_of_forecast(probability, success) <= perfect).all()


@pytest.mark.parametrize("value", [-0.1, float("inf"), float("nan")])
@pytest.mark.parametrize("name", ["failure", "abstention"])
def test_costs_are_finite_and_not_negative(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"the cost of a {name} should be 0 or more"):
        Costs(**{name: value})
