"""The order in which thresholds are tested, and what it depends on."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.guarantees.threshold_sequence import (
    ThresholdSequence,
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
