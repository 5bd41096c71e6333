"""Certification: guarantees hold as often as stated, and are exact."""

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
from graspcast.guarantees.binomial import lower_bound, mean_interval, needed_trials
from graspcast.guarantees.certificate import MAX_UNITS, OVERALL
from graspcast.guarantees.certify import certify
from graspcast.guarantees.threshold_sequence import (
    ThresholdSequence,
    default_sequence,
    learn_sequence,
)
from graspcast.guarantees.unit_draws import UnitDraws, UnitShares, Weight
from synthetic import estimates
from worlds import ASKED, World, drawn

ALONE = World(400, 1)


def at(*thresholds: float) -> ThresholdSequence:
    """A fixed sequence that starts at the first."""
    return ThresholdSequence(thresholds, (1.0, *(0.0 for _ in thresholds[1:])), "the test")


# Whether guarantees hold, in seeded worlds. The margin is three standard deviations of the share
# of false certificates of a method that makes exactly the allowed share.


def false_share(world: World, worlds: int, weight: Weight, *, naive: bool = False) -> float:
    truth = world.truth(trials=100_000)
    false = 0
    for number in range(worlds):
        probability, success, units = drawn(world, number)
        units = np.arange(len(units)) if naive else units
        # The most dangerous single test: at a threshold whose true rate is just below the target.
        bad = float(truth.descending[np.flatnonzero(truth.rates < 0.9)[2500]])
        threshold = certify(
            probability, success, units, sequence=at(bad), weight=weight, **ASKED
        ).overall.threshold
        assert threshold is None or truth.rate(threshold) < 0.9
        false += threshold is not None
    return false / worlds


def margin(worlds: int) -> float:
    return 0.1 + 3 * math.sqrt(0.1 * 0.9 / worlds)


@pytest.mark.parametrize(
    "world",
    [
        ALONE,
        pytest.param(World(60, 10, scene=3.0, alike=1.0), marks=pytest.mark.slow),
        pytest.param(World(100, 5, mislead=1.0), marks=pytest.mark.slow),
    ],
    ids=["alone", "repeats", "misleading scenes"],
)
def test_false_certificates_are_as_rare_as_allowed(world: World) -> None:
    assert false_share(world, 300, "attempt") <= margin(300)


@pytest.mark.slow
def test_treating_trials_as_units_certifies_too_often() -> None:
    world = World(60, 10, scene=3.0, alike=1.0)
    assert false_share(world, 300, "attempt", naive=True) > margin(300)


@pytest.mark.slow
def test_weighting_scenes_equally_guarantees_less() -> None:
    # Where scenes mislead the forecaster, attempts are most in the scenes that fail.
    assert false_share(World(100, 5, mislead=1.5), 300, "unit") > margin(300)


@pytest.mark.slow
@pytest.mark.parametrize("learn", [False, True])
@pytest.mark.parametrize("world", [ALONE, World(150, 6, scene=2.0, over=1.5)])
def test_guarantees_of_whole_sequences_hold(world: World, learn: bool) -> None:
    truth = world.truth(trials=100_000)
    false = 0
    for number in range(100):
        training = drawn(world, 10_000 + number)
        sequence = (
            learn_sequence(*training, calibration_units=world.scenes, **ASKED) if learn else None
        )
        threshold = certify(*drawn(world, number), sequence=sequence, **ASKED).overall.threshold
        false += threshold is not None and truth.rate(threshold) < 0.9
    assert false / 100 <= margin(100)


def test_a_useful_threshold_is_found_where_there_is_one() -> None:
    truth = ALONE.truth(trials=100_000)
    world = World(800, 1)
    found = [certify(*drawn(world, i), **ASKED).overall.threshold for i in range(50)]
    attempts = [0.0 if t is None else truth.attempts(t) for t in found]
    assert np.mean(attempts) > 0.8 * truth.best_attempts(0.9)


@pytest.mark.slow
def test_simultaneous_guarantees_hold_together() -> None:
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
            any_false = any(g.threshold is not None for g in found.guarantees)
            alone, together = (
                alone + (any_false and not simultaneous),
                together + (any_false and simultaneous),
            )
    assert together / 100 <= margin(100) < alone / 100


# Computation.


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
        attempt = probability >= guarantee.reported_threshold
        assert guarantee.drawn_attempts == guarantee.attempts == attempt.sum()
        assert guarantee.drawn_successes == guarantee.successful_attempts == success[attempt].sum()


@pytest.mark.slow
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
    assert often.drawn_attempts == once.drawn_attempts == 15
    assert (once.needed_units, often.needed_units) == (22, 22)
    assert (once.needed_trials, often.needed_trials) == (22, 22 * 40)


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
        assert (guarantee.lower_bound >= 0.9) or guarantee.threshold is None


def test_without_a_certified_threshold_the_needed_units_are_stated() -> None:
    half = np.tile([True, False], 50)
    hopeless = certify(np.full(100, 0.95), half, np.arange(100), **ASKED).overall
    assert hopeless.threshold is None
    assert hopeless.needed_units is None
    assert "nor from 10,000 of these" in str(hopeless)
    few = certify(np.full(10, 0.95), np.ones(10, bool), np.arange(10) // 2, **ASKED).overall
    assert few.needed_units == 22
    assert few.needed_trials == 44
    assert "about 22 new units (44 trials)" in str(few)
    unreached = certify(np.full(10, 0.005), np.ones(10, bool), np.arange(10), **ASKED).overall
    assert (unreached.threshold, unreached.attempts, unreached.lower_bound) == (None, 0, 0.0)


def test_the_needed_units_suffice() -> None:
    probability, success = np.full(20, 0.95), np.arange(20) > 0  # 19 of 20 hold
    needed = certify(probability, success, np.arange(20), **ASKED).overall.needed_units
    assert needed is not None

    def passes(n: int) -> bool:
        held = np.arange(n) >= math.ceil(n / 20)
        found = certify(np.full(n, 0.95), held, np.arange(n), sequence=at(0.9), **ASKED)
        return found.overall.threshold is not None

    assert passes(needed)
    assert not passes(needed - 1)


# Input.


def test_units_have_names() -> None:
    given_ = estimates(6, scenes=3)
    assert unit_names(given_.instances, "scene").tolist() == [
        "d/0",
        "d/0",
        "d/1",
        "d/1",
        "d/2",
        "d/2",
    ]
    assert unit_names(given_.instances, "image").tolist()[-1] == "d/2/5"


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


def sequential(
    draws: UnitDraws, sequence: ThresholdSequence, rate: float, allowed: float
) -> tuple[float | None, float]:
    """The fallback procedure of Wiens, with SciPy's test: the last that passes, and its level."""
    passed: list[tuple[float, float]] = []
    carried = 0.0
    for threshold, weight in zip(sequence.thresholds, sequence.weights, strict=True):
        level = carried + weight * allowed
        attempts, held = draws.count(threshold)
        value = binomtest(held, attempts, rate, alternative="greater").pvalue if attempts else 1.0
        carried = level if level > 0 and value <= level else 0.0
        if carried:
            passed.append((threshold, carried))
    return passed[-1] if passed else (None, allowed)


def fewest_units(
    world: tuple[ndarray, ndarray, ndarray], sequence: ThresholdSequence, rate: float, conf: float
) -> tuple[float, int | None]:
    """The threshold that the fewest units would certify, trying each with any number of them."""
    best: tuple[int, float] | None = None
    for threshold in sequence.thresholds:
        shares = UnitShares.at(threshold, *world)
        share, success_rate = shares.expected_draws("attempt")
        trials = needed_trials(success_rate, rate=rate, confidence=conf) if share else None
        if trials is not None and (best is None or math.ceil(trials / share) < best[0]):
            best = math.ceil(trials / share), threshold
    if best is None or best[0] > MAX_UNITS:
        return sequence.thresholds[int(np.argmax(sequence.weights))], None
    return best[1], best[0]


@pytest.mark.parametrize("scenes", [12, 60, 300])
@pytest.mark.parametrize("seed", range(8))
def test_certification_is_the_fallback_procedure(scenes: int, seed: int) -> None:
    probability, success, units = drawn(World(scenes, 3), seed)
    thresholds = (0.97, 0.93, 0.9, 0.85, 0.8, 0.7, 0.5)
    sequence = ThresholdSequence(thresholds, (0.1, 0.0, 0.4, 0.3, 0.0, 0.2, 0.0), "the test")
    rate, confidence = (0.9, 0.9) if seed % 2 else (0.8, 0.95)
    found = certify(
        probability, success, units, rate=rate, confidence=confidence, sequence=sequence, seed=seed
    ).overall
    draws = UnitDraws(probability, success, units, "attempt", seed)
    certified, level = sequential(draws, sequence, rate, 1 - confidence)
    assert found.threshold == certified
    reported, needed = certified, None
    if certified is None:
        reported, needed = fewest_units((probability, success, units), sequence, rate, confidence)
    assert (found.reported_threshold, found.needed_units) == (reported, needed)
    attempts, held = draws.count(reported)
    assert (found.drawn_attempts, found.drawn_successes) == (attempts, held)
    assert found.lower_bound == pytest.approx(lower_bound(held, attempts, 1 - level))
    assert certified is None or found.lower_bound >= rate
    attempted = probability >= reported
    assert (found.attempts, found.successful_attempts) == (
        attempted.sum(),
        success[attempted].sum(),
    )
    assert (found.units, found.trials) == (scenes, 3 * scenes)
    by_unit = attempted.reshape(scenes, 3).mean(axis=1)
    assert found.attempt_rate == pytest.approx(by_unit.mean())
    assert found.attempt_rate_interval == pytest.approx(mean_interval(by_unit, confidence))


@pytest.mark.parametrize("other", [0, 1, 5])
def test_guarantees_of_other_calls_take_their_part_of_the_error(other: int) -> None:
    probability, success, units = drawn(World(60, 4), 0)
    objects = np.array(["d-1", "d-2", "d-3"])[units % 3]
    options = {"objects": objects, "other_guarantees": other, **ASKED}
    together = certify(probability, success, units, simultaneous=True, **options)
    assert together.family_size == 4 + other
    for guarantee in together.guarantees:
        assert guarantee.confidence == pytest.approx(1 - 0.1 / (4 + other))
    alone = certify(probability, success, units, **options)
    assert alone.family_size == 1
    assert [g.confidence for g in alone.guarantees] == pytest.approx([0.9] * 4)
    assert [g.scope for g in alone.guarantees] == [OVERALL, "d-1", "d-2", "d-3"]
    one = certify(*(x[objects == "d-2"] for x in (probability, success, units)), **ASKED).overall
    assert alone.guarantees[2].threshold == one.threshold
    assert alone.guarantees[2].attempts == one.attempts


@pytest.mark.parametrize("value", [-0.1, 1.1, np.nan, np.inf])
def test_probabilities_are_between_0_and_1(value: float) -> None:
    probability, success, units = np.full(30, 0.9), np.ones(30, bool), np.arange(30)
    for edge in (0.0, 1.0):
        certify(np.r_[probability[1:], edge], success, units, **ASKED)
    with pytest.raises(InputError, match="numbers between 0 and 1"):
        certify(np.r_[probability[1:], value], success, units, **ASKED)
    looks = np.stack([probability, probability], axis=1)
    looks[3, 1] = value
    both = np.stack([success, success], axis=1)
    if np.isnan(value):
        assert certify(looks, both, units, **ASKED).overall.trials == 30
    else:
        with pytest.raises(InputError, match="numbers between 0 and 1"):
            certify(looks, both, units, **ASKED)


def test_more_than_so_many_units_are_not_asked_for() -> None:
    """Where every attempt holds, and all are attempted, units are trials."""
    data = np.full(10, 0.95), np.ones(10, bool), np.arange(10)
    for confidence in (0.9, 0.999):
        for needed in (MAX_UNITS, MAX_UNITS + 1):
            rate = (1 - confidence) ** (1 / needed) - 1e-13
            found = certify(*data, rate=rate, confidence=confidence, sequence=at(0.9)).overall
            assert found.threshold is None
            assert found.needed_units == (needed if needed == MAX_UNITS else None)


@pytest.mark.ill_typed
def test_every_forecast_has_an_outcome() -> None:
    one, two, units = np.full(30, 0.9), np.full((30, 2), 0.9), np.arange(30)
    for probability, success in ((one, two), (two, one), (two, np.full((30, 3), 0.9))):
        with pytest.raises(InputError, match="should have the same shape"):
            certify(probability, success > 0.5, units, **ASKED)
    with pytest.raises(InputError, match="differ in length"):
        certify(one, one[1:] > 0.5, units, **ASKED)
