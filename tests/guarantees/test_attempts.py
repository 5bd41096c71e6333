"""Trials with several forecasts: an oracle of running the policy, guarantees, and old results."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy import ndarray
from scipy.special import expit

from graspcast.errors import InputError
from graspcast.guarantees.attempts import attempts_at, first_to_reach, largest
from graspcast.guarantees.certify import certify
from graspcast.guarantees.threshold_sequence import ThresholdSequence, split_sequence
from graspcast.guarantees.unit_draws import UnitDraws, UnitShares
from worlds import ASKED

NAN = np.nan
PROBABILITY = np.array([[0.5, 0.4, 0.9], [NAN, 0.7, NAN], [0.2, NAN, NAN], [NAN, NAN, NAN]])
SUCCESS = np.array([[0, 1, 1], [1, 0, 1], [1, 1, 1], [1, 1, 1]], dtype=bool)


@pytest.mark.parametrize(
    ("threshold", "attempted", "succeeded"),
    [
        (0.0, [1, 1, 1, 0], [0, 0, 1, 0]),
        (0.3, [1, 1, 0, 0], [0, 0, 0, 0]),
        (0.5, [1, 1, 0, 0], [0, 0, 0, 0]),
        (0.6, [1, 1, 0, 0], [1, 0, 0, 0]),
        (0.9, [1, 0, 0, 0], [1, 0, 0, 0]),
        (1.0, [0, 0, 0, 0], [0, 0, 0, 0]),
    ],
)
def test_the_first_forecast_that_reaches_the_threshold_is_attempted(
    threshold: float, attempted: list[int], succeeded: list[int]
) -> None:
    found = attempts_at(threshold, PROBABILITY, SUCCESS)
    assert [x.astype(int).tolist() for x in found] == [attempted, succeeded]


def test_what_is_no_forecast_is_no_attempt_at_any_threshold() -> None:
    none = np.full((3, 2), NAN)
    assert not attempts_at(0.0, none, np.ones((3, 2), bool))[0].any()
    assert largest(PROBABILITY).tolist() == [0.9, 0.7, 0.2, 0.0]
    expected = [[1, 0, 1], [0, 1, 0], [1, 0, 0], [0, 0, 0]]
    assert first_to_reach(PROBABILITY).astype(int).tolist() == expected


def test_what_is_abstained_from_is_no_attempt_at_threshold_0() -> None:
    """The smallest quantile of a learned sequence is 0 where some are abstained from."""
    rng = np.random.default_rng(0)
    probability = np.where(rng.random((200, 1)) < 0.5, NAN, 1.0)
    success, units = ~np.isnan(probability), np.arange(200)
    sequence, kept = split_sequence(
        probability, success, units, share=0.5, seed=0, weight="unit", **ASKED
    )
    assert sequence.thresholds[-1] == 0.0
    found = certify(
        probability[kept], success[kept], units[kept], sequence=sequence, weight="unit", **ASKED
    ).overall
    assert found.attempts == found.successful_attempts == int(success[kept].sum())
    assert found.threshold == 0.0


def looked(rng: np.random.Generator, scenes: int, repeats: int = 4) -> tuple[ndarray, ...]:
    """Three looks, each surer; later ones guide better; scenes share what is not seen."""
    shape = (scenes, repeats)
    x, common = rng.normal(0.6, 1.2, shape), rng.normal(0, 0.8, (scenes, 1))
    probability, success = [], []
    for noise, better in ((1.5, 0.0), (0.8, 0.8), (0.4, 1.2)):
        seen = x + noise * rng.normal(size=shape)
        probability.append(expit(1.5 * (seen + better) / (1 + noise)).ravel())
        success.append((rng.random(shape) < expit(2 * (x + better) + common)).ravel())
    found = np.stack(probability, axis=1)
    found[rng.random(found.shape) < 0.1] = NAN
    images = rng.integers(1, 4, len(found))
    found[np.arange(3) >= images[:, None]] = NAN
    return found, np.stack(success, axis=1), np.repeat(np.arange(scenes), repeats)


@pytest.mark.slow
def test_guarantees_of_a_policy_hold_as_often_as_stated() -> None:
    truth = looked(np.random.default_rng(987), 30_000)
    grid = np.linspace(0.5, 0.999, 300)
    rates = []
    for threshold in grid.tolist():
        attempted, succeeded = attempts_at(threshold, *truth[:2])
        rates.append(succeeded.sum() / attempted.sum())
    # The most dangerous single test: where the true rate of the policy is just below the target.
    bad = float(grid[np.flatnonzero(np.array(rates) < 0.9)[-1]])
    assert 0.89 < rates[int(np.flatnonzero(grid == bad)[0])] < 0.9
    sequence = ThresholdSequence((bad,), (1.0,), "the test")
    false = 0
    for number in range(300):
        given = looked(np.random.default_rng([1, number]), 150)
        false += certify(*given, sequence=sequence, **ASKED).overall.threshold is not None
    assert 0 < false / 300 <= 0.1 + 3 * math.sqrt(0.1 * 0.9 / 300)


@pytest.mark.parametrize("weight", ["attempt", "unit"])
def test_counts_are_those_of_running_the_policy_at_each_threshold(weight: str) -> None:
    probability, success, units = looked(np.random.default_rng(5), 60)
    draws = UnitDraws(probability, success, units, weight, 0)  # type: ignore[arg-type]
    for threshold in np.linspace(0.0, 1.0, 41).tolist():
        attempts = held = 0
        by_unit = np.zeros((60, 2))
        for i, (forecasts, outcomes) in enumerate(zip(probability, success, strict=True)):
            for p, good in zip(forecasts.tolist(), outcomes.tolist(), strict=True):
                if p >= threshold:
                    attempts, held = attempts + 1, held + good
                    by_unit[units[i]] += 1, good
                    break
        shares = UnitShares.at(threshold, probability, success, units)
        np.testing.assert_array_equal(shares.attempted * 4, by_unit[:, 0])
        found = certify(
            probability,
            success,
            units,
            sequence=ThresholdSequence((threshold,), (1.0,), ""),
            **ASKED,
        ).overall
        assert (found.attempts, found.successful_attempts) == (attempts, held)
        drawn, drawn_held = draws.count(threshold)
        assert drawn_held <= drawn <= (by_unit[:, 0] > 0).sum()
        if weight == "unit":
            assert drawn == (by_unit[:, 0] > 0).sum()


def test_one_forecast_of_each_is_as_it_always_was() -> None:
    probability, success, units = looked(np.random.default_rng(6), 200)
    probability, success = (
        np.where(np.isnan(probability[:, 0]), 0.0, probability[:, 0]),
        success[:, 0],
    )
    flat = certify(probability, success, units, seed=3, **ASKED)
    column = certify(probability[:, None], success[:, None], units, seed=3, **ASKED)
    absent = np.where(probability == 0.0, NAN, probability)[:, None]
    assert flat == column == certify(absent, success[:, None], units, seed=3, **ASKED)


def test_the_draw_does_not_depend_on_the_order_of_the_trials() -> None:
    given = looked(np.random.default_rng(7), 100)
    order = np.random.default_rng(8).permutation(len(given[0]))
    shuffled = [values[order] for values in given]
    assert certify(*given, **ASKED) == certify(*shuffled, **ASKED)


@pytest.mark.ill_typed
def test_shapes_that_differ_are_refused() -> None:
    with pytest.raises(InputError, match="should have the same shape"):
        certify(np.full((4, 2), 0.5), np.ones((4, 3), bool), np.arange(4), **ASKED)
