"""Intervals of success rates hold as often as stated, also with few scenes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from graspcast.evaluation.bootstrap import Interval, original_and_draws
from graspcast.evaluation.success_intervals import drawn_interval, success_interval
from worlds import World


def counts(scenes: int, draws: int = 300) -> np.ndarray:
    return original_and_draws([f"{i:04d}" for i in range(scenes)], draws, 0)


@pytest.mark.parametrize(
    "world",
    [World(10, 20), World(10, 20, scene=3.0), World(10, 8, alike=1.0), World(40, 5, scene=3.0)],
    ids=["10 x 20", "over-dispersed", "repeats", "40 x 5"],
)
@pytest.mark.parametrize("threshold", [0.5, 0.9])
def test_they_cover_the_true_rate(world: World, threshold: float) -> None:
    true, runs = world.truth(trials=200_000).rate(threshold), 200
    missed = 0
    for number in range(runs):
        probability, success, scene = world.draw(np.random.default_rng(number), world.scenes)
        attempted = probability >= threshold
        found = success_interval(attempted, success, scene, counts(world.scenes))
        missed += found is not None and not found.low <= true <= found.high
    # The margin is three standard deviations.
    assert missed / runs <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / runs)


def test_if_none_failed_a_scene_counts_as_one_grasp() -> None:
    scene = np.repeat(np.arange(10), 20)
    found = success_interval(np.ones(200, bool), np.ones(200, bool), scene, counts(10))
    exact = binomtest(10, 10).proportion_ci(0.95, "exact")
    assert found is not None
    assert (found.value, found.high) == (1.0, 1.0)
    assert found.low == pytest.approx(exact.low)


def test_scenes_that_are_all_the_same_are_like_independent_grasps() -> None:
    scene = np.repeat(np.arange(10), 20)
    success = np.tile(np.arange(20) < 15, 10)
    found = success_interval(np.ones(200, bool), success, scene, counts(10))
    exact = binomtest(150, 200).proportion_ci(0.95, "exact")
    assert found is not None and found.value == 0.75
    assert (found.low, found.high) == pytest.approx((exact.low, exact.high))


def test_scenes_that_differ_widen_it() -> None:
    scene, every = np.repeat(np.arange(12), 20), np.ones(240, bool)
    alike = np.tile(np.arange(20) < 10, 12)
    apart = np.concatenate([np.arange(20) < (18 if i % 2 else 2) for i in range(12)])
    narrow, wide = (success_interval(every, s, scene, counts(12)) for s in (alike, apart))
    assert narrow is not None and wide is not None
    assert wide.value == narrow.value == 0.5
    assert wide.high - wide.low > 2 * (narrow.high - narrow.low)


def test_many_scenes_are_drawn_and_a_single_one_is_not() -> None:
    rng = np.random.default_rng(0)
    scene = np.repeat(np.arange(150), 4)
    success = rng.random(600) < 0.8
    many = success_interval(np.ones(600, bool), success, scene, counts(150))
    assert many is not None and many.low < 0.8 < many.high
    assert many.high - many.low < 0.09
    alone = success_interval(np.ones(4, bool), np.ones(4, bool), np.zeros(4, int), counts(1))
    assert alone is not None and alone.low == pytest.approx(0.025)


def test_without_attempts_there_is_none() -> None:
    assert success_interval(np.zeros(4, bool), np.ones(4, bool), np.arange(4), counts(4)) is None


@pytest.mark.parametrize("rate", [0.0, 1.0])
def test_draws_that_are_all_alike_make_no_interval(rate: float) -> None:
    scene = np.array([0, 4, 7])
    tried, success = np.ones(3, bool), np.full(3, rate)
    found = drawn_interval(tried, success, scene, counts(10))
    assert found == success_interval(tried, success, scene, counts(10))
    exact = binomtest(int(3 * rate), 3).proportion_ci(0.95, "exact")
    assert found is not None
    assert (found.low, found.high) == pytest.approx((exact.low, exact.high))


def test_other_rates_have_the_interval_of_the_draws() -> None:
    scene, success = np.repeat(np.arange(4), 5), np.tile([1.0, 1.0, 0.0, 1.0, 0.0], 4)
    success[:5] = 1.0
    found = drawn_interval(np.ones(20, bool), success, scene, counts(4))
    rates = counts(4) @ np.bincount(scene, weights=success) / 20
    assert found == Interval.of(rates[0], rates[1:], (0.0, 1.0))
    assert drawn_interval(np.zeros(20, bool), success, scene, counts(4)) is None
