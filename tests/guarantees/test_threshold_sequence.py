"""The order in which thresholds are tested, and what it depends on."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from graspcast.errors import InputError
from graspcast.guarantees.binomial import lower_bound, p_value
from graspcast.guarantees.threshold_sequence import (
    ThresholdSequence,
    check_target,
    default_sequence,
    from_threshold_on,
    learn_sequence,
    split_sequence,
)
from worlds import ASKED, World, drawn


def test_the_default_sequence_depends_on_the_rate_alone() -> None:
    sequence = default_sequence(0.9)
    starts = {t: w for t, w in zip(sequence.thresholds, sequence.weights, strict=True) if w}
    assert starts == {0.95: 0.25, 0.9: 0.5, 0.8: 0.25}
    for rate in (0.01, 0.3, 0.5, 0.999):
        assert rate in default_sequence(rate).thresholds


def test_a_learned_sequence_starts_where_the_test_will_likely_pass() -> None:
    world = World(100, 1, over=0.3)  # never near 0.9
    sequence = learn_sequence(*drawn(World(2000, 1, over=0.3), 0), calibration_units=100, **ASKED)
    truth = world.truth(trials=100_000)
    start = sequence.thresholds[sequence.weights.index(1.0)]
    assert truth.rate(start) > 0.9
    assert truth.attempts(start) * 100 >= 22
    more = learn_sequence(*drawn(World(2000, 1, over=0.3), 0), calibration_units=2000, **ASKED)
    assert more.thresholds == sequence.thresholds


def test_units_that_the_sequence_is_learned_from_do_not_certify() -> None:
    probability, success, units = drawn(World(100, 4), 0)
    options = {"seed": 0, "weight": "attempt", **ASKED}
    sequence, kept = split_sequence(probability, success, units, share=0.25, **options)
    assert len(np.unique(units[kept])) == 75
    assert not set(units[kept]) & set(units[~kept])
    # Outcomes of those that remain take no part in the sequence.
    flipped = np.where(kept, ~success, success)
    assert split_sequence(probability, flipped, units, share=0.25, **options)[0] == sequence
    default, everything = split_sequence(probability, success, units, share=0.0, **options)
    assert default == default_sequence(0.9)
    assert everything.all()
    with pytest.raises(InputError, match="leaves one of the two parts empty"):
        split_sequence(probability, success, units, share=1.0, **options)


@pytest.mark.parametrize(
    ("thresholds", "weights", "message"),
    [
        ((), (), "descending"),
        ((0.5, 0.6), (1.0, 0.0), "descending"),
        ((1.5, 0.6), (1.0, 0.0), "between 0 and 1"),
        ((0.6, 0.5), (0.9, 0.0), "sum to 1"),
        ((0.6, 0.5), (1.5, -0.5), "none negative"),
        ((0.6, 0.5), (1.0,), "one weight for each"),
    ],
)
def test_bad_sequences_are_refused(
    thresholds: tuple[float, ...], weights: tuple[float, ...], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        ThresholdSequence(thresholds, weights, "the test")


def test_thresholds_below_one_give_it_what_they_were_allowed() -> None:
    whole = ThresholdSequence((0.9, 0.8, 0.7, 0.6), (0.1, 0.2, 0.3, 0.4), "test")
    cut = from_threshold_on(whole, 0.75)
    assert cut.thresholds == (0.9, 0.8, 0.75)
    assert cut.weights == pytest.approx((0.1, 0.2, 0.7))
    assert from_threshold_on(whole, 0.5) is whole
    assert from_threshold_on(whole, 0.95).thresholds == (0.95,)


@pytest.mark.parametrize(
    ("rate", "above", "below"),
    [(0.9, 0.95, 0.8), (0.8, 0.9, 0.6), (0.6, 0.8, 0.3), (0.3, 0.65, 0.15), (0.985, 0.9925, 0.97)],
)
def test_the_default_sequence_is_every_hundredth_and_where_it_starts(
    rate: float, above: float, below: float
) -> None:
    sequence = default_sequence(rate)
    grid = {k / 100 for k in range(1, 100)} | {rate, above, below}
    assert sequence.thresholds == tuple(sorted(grid, reverse=True))
    starts = {t: w for t, w in zip(sequence.thresholds, sequence.weights, strict=True) if w}
    assert starts == {above: 0.25, rate: 0.5, below: 0.25}


@pytest.mark.parametrize("value", [0.0, 1.0, -0.1, 1.1, float("nan")])
@pytest.mark.parametrize("name", ["rate", "confidence"])
def test_a_target_is_above_0_and_below_1(name: str, value: float) -> None:
    with pytest.raises(InputError, match=f"the {name} should be above 0 and below 1") as caught:
        check_target(name, value)
    assert caught.value.parameters == (name,)
    check_target(name, 1e-9)
    check_target(name, 1 - 1e-9)


def test_thresholds_may_be_0_and_1_but_not_twice_the_same() -> None:
    both = ThresholdSequence((1.0, 0.0), (0.5, 0.5), "the test")
    assert ThresholdSequence.from_dict(both.as_dict()) == both
    assert ThresholdSequence((0.5,), (1.0 + 1e-10,), "rounded").weights == (1.0 + 1e-10,)
    for thresholds in ((0.5, 0.5), (0.5, -0.1), (1.1, 0.5)):
        with pytest.raises(InputError, match="descending thresholds between 0 and 1"):
            ThresholdSequence(thresholds, (0.5, 0.5), "the test")
    for weights in ((0.5, 0.4), (0.5, 0.6), (0.5, 0.5 + 1e-6)):
        with pytest.raises(InputError, match="that sum to 1"):
            ThresholdSequence((0.6, 0.5), weights, "the test")


def by_hand(
    probability: np.ndarray, success: np.ndarray, threshold: float, calibration: int
) -> tuple[float, float]:
    """Power and bound of the test at a threshold, where each unit has one trial."""
    attempted = probability >= threshold
    trials, rate = int(calibration * attempted.mean()), success[attempted].mean()
    held = np.arange(trials + 1)
    passes = np.array([p_value(int(h), trials, 0.9) <= 1 - 0.9 for h in held])
    chance = float(binom.pmf(held, trials, rate)[passes].sum()) if trials else 0.0
    return chance, lower_bound(int(trials * rate), trials, 0.9)


@pytest.mark.parametrize(("calibration", "in_reach"), [(400, True), (60, True), (8, False)])
def test_testing_starts_in_the_middle_of_the_highest_power_or_at_the_highest_bound(
    calibration: int, in_reach: bool
) -> None:
    probability, success, units = drawn(World(1000, 1), 3)
    sequence = learn_sequence(probability, success, units, calibration_units=calibration, **ASKED)
    thresholds = np.array(sequence.thresholds)
    # Fifty quantiles: 2 %, 4 %, … of the trials are attempted, all at the last.
    attempted = (probability >= thresholds[:, None]).sum(axis=1)
    assert np.abs(attempted - 20 * np.arange(1, 51)).max() <= 1
    assert attempted[-1] == 1000
    powers, bounds = np.transpose(
        [by_hand(probability, success, t, calibration) for t in thresholds.tolist()]
    )
    plateau = np.flatnonzero(powers >= powers.max() - 0.01)
    start = plateau[len(plateau) // 2] if in_reach else bounds.argmax()
    assert (powers.max() >= 0.01) == in_reach
    assert sequence.weights == tuple((np.arange(50) == start).astype(float).tolist())
    assert sequence.source == "1000 out-of-fold trials"


def test_the_split_learns_from_the_chosen_for_those_that_remain() -> None:
    probability, success, units = drawn(World(120, 3), 2)
    options = {"weight": "attempt", **ASKED}
    sequence, kept = split_sequence(probability, success, units, share=0.4, seed=5, **options)
    chosen = ~kept
    assert len(np.unique(units[chosen])) == 48
    learned = learn_sequence(
        probability[chosen], success[chosen], units[chosen], calibration_units=72, **options
    )
    assert (sequence.thresholds, sequence.weights) == (learned.thresholds, learned.weights)
    assert sequence.source == "48 of 120 units, not used for certification"
    other = split_sequence(probability, success, units, share=0.4, seed=6, **options)[1]
    assert (other != kept).any()


@pytest.mark.parametrize(
    ("share", "learned"), [(0.04, None), (0.1, 1), (0.9, 9), (0.96, None), (-0.1, None)]
)
def test_each_part_of_a_split_has_a_unit(share: float, learned: int | None) -> None:
    probability, success, units = drawn(World(10, 5), 0)
    options = {"seed": 0, "weight": "attempt", **ASKED}
    if learned is None:
        with pytest.raises(InputError, match="of 10 units leaves one of the two parts empty"):
            split_sequence(probability, success, units, share=share, **options)
    else:
        _, kept = split_sequence(probability, success, units, share=share, **options)
        assert len(np.unique(units[~kept])) == learned


def test_a_cut_sequence_keeps_what_is_above_it() -> None:
    whole = ThresholdSequence((0.9, 0.8, 0.7), (0.1, 0.2, 0.7), "test")
    cut = from_threshold_on(whole, 0.8)
    assert cut.thresholds == (0.9, 0.8)
    assert cut.weights == pytest.approx((0.1, 0.9))
    assert from_threshold_on(whole, 0.7).weights == pytest.approx(whole.weights)


@pytest.mark.parametrize("weights", [(1.0, 1.0), (1.0, 2.0), (0.0, 0.0)])
def test_weights_sum_to_1_and_to_no_other_whole_number(weights: tuple[float, float]) -> None:
    with pytest.raises(InputError, match="that sum to 1"):
        ThresholdSequence((0.6, 0.5), weights, "the test")
