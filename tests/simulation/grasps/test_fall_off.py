"""How success falls with the size of an error, from few trials."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.simulation.grasps.fall_off import FallOff, bounds_of, measure_fall_off


def test_the_crossings_of_a_known_curve_are_within_their_intervals() -> None:
    rng = np.random.default_rng(4)
    half, slope = 12.0, 6.0
    inside: list[bool] = []
    for _ in range(30):
        curve = measure_fall_off(
            lambda size: bool(rng.random() < 1 / (1 + (size / half) ** slope)),
            100.0,
            32,
            rng,
            held=24,
            of=24,
        )
        for level in (0.5, 0.9):
            true = half * (1 / level - 1) ** (1 / slope)
            found = curve.crossing(level)
            assert found.value == pytest.approx(true, rel=0.5)
            inside.append(found.low <= true <= found.high)
    assert np.mean(inside) > 0.8  # of intervals of 90 %


def test_a_sharp_edge_is_found_to_some_percent() -> None:
    rng = np.random.default_rng(0)
    curve = measure_fall_off(lambda size: size < 7.0, 100.0, 24, rng, held=24, of=24)
    assert curve.trials == 24
    for level in (0.5, 0.9):
        assert curve.crossing(level).value == pytest.approx(7.0, rel=0.12)


def test_what_succeeds_again_farther_away_is_never_tried() -> None:
    tried: list[float] = []

    def quarter_turns(size: float) -> bool:
        tried.append(size)
        return size < 12.0 or size > 60.0

    curve = measure_fall_off(quarter_turns, 90.0, 24, np.random.default_rng(1), held=24, of=24)
    assert max(tried) < 60
    assert curve.crossing(0.5).value == pytest.approx(12.0, rel=0.15)


def test_success_that_never_falls_reaches_the_limit() -> None:
    curve = measure_fall_off(lambda size: True, 0.1, 16, np.random.default_rng(0), held=24, of=24)
    assert curve.crossing(0.9).value == curve.crossing(0.5).value == 0.1


def test_a_grasp_that_fails_by_itself_tolerates_nothing() -> None:
    rng = np.random.default_rng(0)
    curve = measure_fall_off(lambda size: bool(rng.random() < 0.6), 0.1, 24, rng, held=14, of=24)
    assert curve.crossing(0.9) == (0.0, 0.0, 0.0)
    assert measure_fall_off(lambda size: False, 0.1, 9, rng, of=24).crossing(0.5).value == 0.0


def test_rates_fall_and_bounds_are_quantiles() -> None:
    curve = FallOff(1.0, held=24, of=24)
    curve.add(0.2, success=True)
    curve.add(0.4, success=False)
    rates = curve.rates(np.array([0.0, 0.1, 0.3, 0.9])).mean(axis=0)
    assert (np.diff(rates) < 0).all()
    assert rates[0] > 0.95
    assert bounds_of(np.arange(101.0)) == (50.0, 5.0, 95.0)
