"""Promises: kept as often as they say, exact, and honest where none can be made."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy import ndarray
from scipy.stats import binomtest

from graspcast.errors import InputError
from graspcast.estimates.instances import unit_names
from graspcast.guarantees.certificate import Weight
from graspcast.guarantees.certify import certify
from graspcast.guarantees.threshold_sequence import (
    ThresholdSequence,
    default_sequence,
    learn_sequence,
)
from synthetic import estimates
from worlds import ASKED, World, drawn

ALONE = World(400, 1)


def at(*thresholds: float) -> ThresholdSequence:
    """A fixed sequence that starts at the first."""
    return ThresholdSequence(thresholds, (1.0, *(0.0 for _ in thresholds[1:])), "the test")


# Whether promises are kept: seeded worlds, so no chance is left; the margin is what chance would
# allow a method that breaks exactly the allowed share (three standard deviations).


def broken_share(world: World, worlds: int, weight: Weight, *, naive: bool = False) -> float:
    truth = world.truth(trials=100_000)
    broken = 0
    for number in range(worlds):
        probability, success, units = drawn(world, number)
        units = np.arange(len(units)) if naive else units
        # The most dangerous single test: at a threshold whose true rate is just below the target.
        bad = float(truth.descending[np.flatnonzero(truth.rates < 0.9)[2500]])
        threshold = certify(
            probability, success, units, sequence=at(bad), weight=weight, **ASKED
        ).overall.threshold
        assert threshold is None or truth.rate(threshold) < 0.9
        broken += threshold is not None
    return broken / worlds


def margin(worlds: int) -> float:
    return 0.1 + 3 * math.sqrt(0.1 * 0.9 / worlds)


@pytest.mark.parametrize(
    "world",
    [ALONE, World(60, 10, scene=3.0, alike=1.0), World(100, 5, mislead=1.0)],
    ids=["alone", "repeats", "misleading scenes"],
)
def test_what_is_false_is_certified_no_more_often_than_allowed(world: World) -> None:
    assert broken_share(world, 300, "attempt") <= margin(300)


def test_trials_as_units_would_break_the_promise() -> None:
    world = World(60, 10, scene=3.0, alike=1.0)
    assert broken_share(world, 300, "attempt", naive=True) > margin(300)


def test_counting_scenes_alike_promises_less() -> None:
    # Where scenes mislead the forecaster, attempts are most in the scenes that fail.
    assert broken_share(World(100, 5, mislead=1.5), 300, "unit") > margin(300)


@pytest.mark.slow
@pytest.mark.parametrize("learn", [False, True])
@pytest.mark.parametrize("world", [ALONE, World(150, 6, scene=2.0, over=1.5)])
def test_whole_sequences_keep_the_promise(world: World, learn: bool) -> None:
    truth = world.truth(trials=100_000)
    broken = 0
    for number in range(100):
        training = drawn(world, 10_000 + number)
        sequence = (
            learn_sequence(*training, calibration_units=world.scenes, **ASKED) if learn else None
        )
        threshold = certify(*drawn(world, number), sequence=sequence, **ASKED).overall.threshold
        broken += threshold is not None and truth.rate(threshold) < 0.9
    assert broken / 100 <= margin(100)


def test_a_useful_threshold_is_found_where_there_is_one() -> None:
    truth = ALONE.truth(trials=100_000)
    world = World(800, 1)
    found = [certify(*drawn(world, i), **ASKED).overall.threshold for i in range(50)]
    attempts = [0.0 if t is None else truth.attempts(t) for t in found]
    assert np.mean(attempts) > 0.8 * truth.best_attempts(0.9)


def test_promises_together_are_rarely_any_broken() -> None:
    truth = ALONE.truth(trials=100_000)
    bad = at(float(truth.descending[np.flatnonzero(truth.rates < 0.9)[1000]]))
    alone = together = 0
    for number in range(100):
        probability, success, units = drawn(World(1200, 1), number)
        objects = np.array(["d-1", "d-2", "d-3", "d-4"])[units % 4]
        for simultaneous in (False, True):
            found = certify(
                probability,
                success,
                units,
                objects=objects,
                sequence=bad,
                simultaneous=simultaneous,
                **ASKED,
            )
            any_broken = any(p.threshold is not None for p in found.guarantees)
            alone, together = (
                alone + (any_broken and not simultaneous),
                together + (any_broken and simultaneous),
            )
    assert together / 100 <= margin(100) < alone / 100


# What is computed.


def by_hand(probability: ndarray, success: ndarray, sequence: ThresholdSequence) -> float | None:
    """The fallback procedure on independent trials, with SciPy's exact test."""
    carried, best = 0.0, None
    for threshold, weight in zip(sequence.thresholds, sequence.weights, strict=True):
        level = carried + 0.1 * weight
        mine = success[probability >= threshold]
        carried = 0.0
        if level and len(mine):
            test = binomtest(int(mine.sum()), len(mine), 0.9, alternative="greater")
            if test.pvalue <= level:
                best, carried = threshold, level
    return best


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_trials_of_their_own_units_give_the_plain_exact_test(number: int) -> None:
    world = World(150, 1, over=1.3)
    probability, success, units = drawn(world, number)
    for sequence in (default_sequence(0.9), at(0.95, 0.9, 0.8, 0.6)):
        guarantee = certify(probability, success, units, sequence=sequence, **ASKED).overall
        assert guarantee.threshold == by_hand(probability, success, sequence)
        attempt = probability >= guarantee.shown_at
        assert guarantee.attempted_units == guarantee.attempts == attempt.sum()
        assert guarantee.successes == guarantee.attempts_held == success[attempt].sum()


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.sampled_from(["attempt", "unit"]))
def test_the_order_of_trials_and_the_names_of_units_do_not_matter(
    number: int, weight: Weight
) -> None:
    rng = np.random.default_rng(number)
    probability, success, units = World(60, 4, scene=2.0).draw(rng, 60)
    probability = probability.round(2)  # ties
    objects = np.array(["d-1", "d-2"])[rng.integers(2, size=len(units))]
    order = rng.permutation(len(units))
    first = certify(probability, success, units, objects=objects, weight=weight, **ASKED)
    again = certify(
        probability[order],
        success[order],
        units[order] + 1000,
        objects=objects[order],
        weight=weight,
        **ASKED,
    )
    assert first == again


@pytest.mark.parametrize("weight", ["attempt", "unit"])
def test_repeating_every_trial_is_no_further_evidence(weight: Weight) -> None:
    probability = np.full(15, 0.95)
    success = np.ones(15, bool)
    once = certify(probability, success, np.arange(15), weight=weight, **ASKED).overall
    often = certify(
        np.repeat(probability, 40),
        np.repeat(success, 40),
        np.repeat(np.arange(15), 40),
        weight=weight,
        **ASKED,
    ).overall
    assert once.threshold is None
    assert often.threshold is None
    assert often.attempted_units == once.attempted_units == 15
    assert (once.needed_units, often.needed_units) == (22, 22)
    assert (once.needed_trials, often.needed_trials) == (22, 22 * 40)


def test_each_weight_draws_what_it_says() -> None:
    # Every unit: one attempt that holds, three trials that are not attempted (and fail).
    m = 400
    probability = np.tile([0.95, 0.1, 0.1, 0.1], m)
    success = np.tile([True, False, False, False], m)
    units = np.repeat(np.arange(m), 4)
    every = certify(probability, success, units, sequence=at(0.9), weight="unit", **ASKED).overall
    some = certify(probability, success, units, sequence=at(0.9), **ASKED).overall
    assert (every.attempted_units, every.successes) == (m, m)
    assert some.attempted_units == some.successes
    assert abs(some.attempted_units - m / 4) < 4 * math.sqrt(m * 3 / 16)
    for guarantee in (every, some):
        assert guarantee.attempt_rate == pytest.approx(0.25)
        low, high = guarantee.attempt_interval
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
        assert found.attempted_units == 40
        held.append(found.successes)
    assert abs(np.mean(held) - 20) < 3 * math.sqrt(10 / 300)
    assert 7 < np.var(held) < 13


def test_asking_for_more_never_lowers_the_threshold() -> None:
    for number in range(20):
        data = drawn(ALONE, number)
        sequence = at(*(np.arange(95, 5, -5) / 100))
        last = 0.0
        for rate, confidence in ((0.6, 0.8), (0.7, 0.8), (0.7, 0.95), (0.9, 0.95), (0.99, 0.99)):
            found = certify(*data, rate=rate, confidence=confidence, sequence=sequence).overall
            threshold = 2.0 if found.threshold is None else found.threshold
            assert threshold >= last
            last = threshold


def test_the_certified_bound_reaches_the_rate() -> None:
    for number in range(20):
        guarantee = certify(*drawn(World(150, 4), number), **ASKED).overall
        assert (guarantee.lower >= 0.9) or guarantee.threshold is None


def test_nothing_to_certify_is_said_with_what_would_be_needed() -> None:
    half = np.tile([True, False], 50)
    hopeless = certify(np.full(100, 0.95), half, np.arange(100), **ASKED).overall
    assert hopeless.threshold is None
    assert hopeless.needed_units is None
    assert "nor from 10,000 of these" in str(hopeless)
    few = certify(np.full(10, 0.95), np.ones(10, bool), np.arange(10) // 2, **ASKED).overall
    assert few.needed_units == 22
    assert few.needed_trials == 44
    assert "about 22 fresh units (44 trials)" in str(few)
    unreached = certify(np.full(10, 0.005), np.ones(10, bool), np.arange(10), **ASKED).overall
    assert (unreached.threshold, unreached.attempts, unreached.lower) == (None, 0, 0.0)


def test_so_many_units_as_are_said_to_be_needed_do() -> None:
    probability, success = np.full(20, 0.95), np.arange(20) > 0  # 19 of 20 hold
    needed = certify(probability, success, np.arange(20), **ASKED).overall.needed_units
    assert needed is not None

    def passes(n: int) -> bool:
        held = np.arange(n) >= math.ceil(n / 20)
        found = certify(np.full(n, 0.95), held, np.arange(n), sequence=at(0.9), **ASKED)
        return found.overall.threshold is not None

    assert passes(needed)
    assert not passes(needed - 1)


# Input, output.


def test_units_have_names() -> None:
    given_ = estimates(6, scenes=3)
    assert unit_names(given_, "scene").tolist() == ["d/0", "d/0", "d/1", "d/1", "d/2", "d/2"]
    assert unit_names(given_, "image").tolist()[-1] == "d/2/5"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": 1.0}, "rate should be above 0 and below 1"),
        ({"confidence": 0.0}, "confidence should be above 0 and below 1"),
        ({"weight": "scene"}, "unknown weight 'scene'"),
        ({"probability": np.full(4, 1.1)}, "between 0 and 1"),
        ({"probability": np.array([0.1, 0.2, 0.3, np.nan])}, "between 0 and 1"),
        ({"objects": np.array(["d-1"])}, "differ in length"),
    ],
)
@pytest.mark.ill_typed
def test_bad_input_is_refused(change: dict[str, object], message: str) -> None:
    good = {
        "probability": np.full(4, 0.5),
        "success": np.ones(4, bool),
        "units": np.arange(4),
        **ASKED,
    }
    with pytest.raises(InputError, match=message):
        certify(**{**good, **change})  # type: ignore[arg-type]


def test_no_trials_are_refused() -> None:
    with pytest.raises(InputError, match="no calibration trials"):
        certify(np.zeros(0), np.zeros(0, bool), np.zeros(0, int), **ASKED)
