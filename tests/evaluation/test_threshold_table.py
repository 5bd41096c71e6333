"""Tables of thresholds: their rows by hand, and what is said of the best one."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.errors import InputError
from graspcast.evaluation.best_threshold import Trials
from graspcast.evaluation.net_benefit import Costs
from graspcast.evaluation.threshold_table import threshold_table
from worlds import World

PRICE = Costs(2.0, 0.2, 0.05)


def world_trials(seed: int = 0, scenes: int = 20, *, outcomes: bool = True) -> Trials:
    world = World(scenes, 10)
    p, success, scene = world.draw(np.random.default_rng(seed), scenes)
    names = np.array([f"d/{number}" for number in scene.tolist()])
    return Trials.of_one_look(p, success if outcomes else None, names)


@given(st.integers(0, 1000), st.floats(0, 1))
def test_rows_are_right_and_few_and_have_the_threshold_in_use(seed: int, asked: float) -> None:
    trials = world_trials(seed)
    table = threshold_table(trials, PRICE, asked=asked, draws=50)
    thresholds = [row.threshold for row in table.rows]
    assert len(thresholds) <= 10
    assert thresholds == sorted(thresholds, reverse=True)
    assert asked in thresholds and 0.0 in thresholds
    assert [row.threshold for row in table.rows if row.asked] == [asked]
    assert [row.threshold for row in table.rows if row.break_even] == [pytest.approx(0.6)]
    assert trials.success is not None
    p, held = trials.probability[:, 0], trials.success[:, 0]
    for row in table.rows:
        attempt = p >= row.threshold
        assert row.attempts == attempt.sum()
        assert row.attempted == pytest.approx(attempt.mean())
        if row.attempts:
            assert row.success is not None
            assert row.success.value == pytest.approx(held[attempt].mean())
            assert row.success.low <= row.success.value <= row.success.high
        expected = np.where(attempt, held - 2.0 * (1 - held), -0.2).mean()
        assert row.net_benefit == pytest.approx(expected)
    shares = [row.attempted for row in table.rows]
    assert shares == sorted(shares)
    best = max(row.net_benefit for row in table.rows)
    assert table.best.net_benefit == pytest.approx(best)


def test_the_best_is_said_to_be_optimistic() -> None:
    gaps = []
    for seed in range(20):
        best = threshold_table(world_trials(seed, 10), PRICE, draws=50).best
        assert best.elsewhere is not None and best.at_break_even is not None
        gaps.append(best.net_benefit - best.elsewhere.value)
    assert np.mean(gaps) > 0


def test_without_outcomes_it_is_what_forecasts_expect() -> None:
    trials = world_trials(outcomes=False)
    table = threshold_table(trials, PRICE, asked=0.8)
    assert not table.measured
    row = next(row for row in table.rows if row.asked)
    p = trials.probability[:, 0]
    assert row.success is not None
    assert row.success.value == pytest.approx(p[p >= 0.8].mean())
    assert np.isnan(row.success.low)
    assert table.best.elsewhere is None and table.best.at_break_even is None
    # By the forecasts themselves nothing is better than the break-even probability.
    assert table.best.threshold is not None
    assert (p >= table.best.threshold).sum() == (p >= 0.6).sum()


def test_looks_are_counted_as_the_policy_takes_them() -> None:
    nan = float("nan")
    trials = Trials(
        probability=np.array([[0.9, nan], [0.3, 0.7], [0.2, 0.1], [nan, nan]]),
        success=np.array([[1.0, 0], [0, 1], [0, 0], [1, 1]]),
        looks=np.array([[1, 2]] * 4),
        ended=np.array([1, 2, 2, 2]),
        scenes=np.array(["d/1", "d/1", "d/2", "d/2"]),
    )
    found = threshold_table(trials, Costs(1.0, 0.0, 0.1), at=[0.5, 0.25, 0.0])
    strict, middle, every = found.rows
    assert (strict.attempts, strict.looks) == (2, pytest.approx((1 + 2 + 2 + 2) / 4))
    assert (middle.attempts, middle.looks) == (2, pytest.approx((1 + 1 + 2 + 2) / 4))
    assert (every.attempts, every.looks) == (3, pytest.approx((1 + 1 + 1 + 2) / 4))
    assert strict.net_benefit == pytest.approx((1 + (1 - 0.1) - 0.1 - 0.1) / 4)
    assert middle.success is not None and middle.success.value == 0.5


def test_thresholds_that_were_not_recorded_are_left_out() -> None:
    table = threshold_table(world_trials(), Costs(20.0, 0.0), asked=0.5, most=0.5)
    assert max(row.threshold for row in table.rows) == 0.5
    assert table.best.threshold == 0.5
    assert table.best.at_break_even is None


def test_it_is_plain_json() -> None:
    content = threshold_table(world_trials(scenes=1), PRICE).as_dict()
    assert json.loads(json.dumps(content, allow_nan=False)) == content
    assert content["best"]["elsewhere"] is None
    assert content["costs"] == {"failure": 2.0, "abstention": 0.2, "look": 0.05}


def test_nothing_to_choose_on_is_refused() -> None:
    empty = Trials.of_one_look(np.zeros(0), np.zeros(0), np.zeros(0, str))
    with pytest.raises(InputError, match="nothing to choose"):
        threshold_table(empty, PRICE)
