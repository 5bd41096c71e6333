"""Verdicts: the threshold, and the file."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from graspcast.errors import InputError
from graspcast.estimates.alignment import Estimates, IncompleteInstance
from graspcast.estimates.instances import InstanceKey, Instances
from graspcast.forecasting.novelty import Disagreement
from graspcast.forecasting.verdict import (
    Verdict,
    check_threshold,
    decide,
    said_by,
    verdict_rows,
)
from poses import random_poses

share = st.floats(0, 1)


@given(share, share)
def test_attempt_at_the_threshold_or_above(probability: float, threshold: float) -> None:
    verdict = decide(probability, threshold)
    assert verdict.attempt == (probability >= threshold)
    assert str(verdict) == ("attempt" if verdict.attempt else "abstain")
    assert verdict.probability == probability


def test_the_reason_states_both_numbers() -> None:
    assert decide(0.75, 0.75) == Verdict(True, 0.75, "probability 0.750 >= 0.75", 0.75)
    assert decide(0.7499, 0.75).reason == "probability 0.750 < 0.75"
    assert decide(0.1, 0.5).reason == "probability 0.100 < 0.5"


def test_novel_disagreement_is_abstained_from_and_what_cannot_be_checked_is_said() -> None:
    for each, attempt, novel, said in (
        (Disagreement(0.5, 0.001), True, False, ""),
        (Disagreement(0.01, 0.001), False, True, "; out-of-distribution disagreement (p-value"),
        (Disagreement(0.5, 0.001, "b is far"), False, True, "disagreement (b is far)"),
        (Disagreement(0.5, 0.02), True, None, "; novelty not checkable at level 0.01 (smallest"),
    ):
        verdict = decide(0.9, 0.5, disagreement=each)
        assert (verdict.attempt, verdict.out_of_distribution) == (attempt, novel)
        assert verdict.p_value == each.p_value
        assert said in verdict.reason
    accepted = decide(0.9, 0.5, disagreement=Disagreement(0.01, 0.001), ood_alpha=0.0)
    assert accepted.attempt


@pytest.mark.parametrize("threshold", [-1e-9, 1 + 1e-9, float("nan"), float("inf")])
def test_a_threshold_that_is_no_probability(threshold: float) -> None:
    with pytest.raises(InputError, match=f"between 0 and 1, not {threshold}"):
        check_threshold(threshold)


@given(share)
def test_a_threshold_that_is_one(threshold: float) -> None:
    assert check_threshold(threshold) == threshold


def test_rows_are_ordered_by_key_and_incomplete_instances_are_abstained_from() -> None:
    poses = random_poses(3)
    estimates = Estimates(
        ("a", "b"),
        Instances.of([InstanceKey("d", 1, 7, 2, 1), InstanceKey("d", 1, 7, 2, 0)]),
        np.stack([poses[:2], poses[:2]]),
        incomplete=(IncompleteInstance(InstanceKey("d", 1, 3, 2, 0), ("b",), poses[2]),),
    )
    given_verdicts = [decide(0.2, 0.5), decide(0.9, 0.5)]
    rows = verdict_rows(estimates, given_verdicts, principal="a", gripper="hand")
    assert [row.key[2:] for row in rows] == [(3, 2, 0), (7, 2, 0), (7, 2, 1)]
    assert [row.verdict.attempt for row in rows] == [False, True, False]
    assert rows[0].verdict.probability is None
    assert rows[0].verdict.reason == "no estimate by b"
    for row, pose in zip(rows, poses[[2, 1, 0]], strict=True):
        assert_array_equal(row.cam_T_obj, pose)


@pytest.mark.parametrize("threshold", [0.0, 0.8, 1e-05, 0.123456, 1.0, None])
@pytest.mark.parametrize("probability", [0.0, 0.79996, 1.0])
@pytest.mark.parametrize("excess", ["", "larger than in training"])
def test_a_reason_says_what_decided(
    probability: float, threshold: float | None, excess: str
) -> None:
    disagreement = Disagreement(0.5, 0.001, excess) if excess else None
    verdict = decide(probability, threshold, disagreement=disagreement)
    assert said_by(verdict.reason) == (threshold, bool(excess))


@pytest.mark.parametrize("reason", ["", "why", "probability 0.5 >= 7e99", "probability 0.5 < 1-2"])
def test_a_reason_of_others_says_nothing(reason: str) -> None:
    assert said_by(reason) == (None, False)
