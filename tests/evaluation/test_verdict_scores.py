"""Verdicts against outcomes: rates by hand, intervals by another bootstrap."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import polars as pl
import pytest

from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.instances import InstanceKey
from graspcast.evaluation.verdict_scores import score_verdicts, verdict_table
from graspcast.forecasting.verdict import Verdict, VerdictRow


def verdicts(
    scene: np.ndarray, attempt: np.ndarray, gripper: str = "hand", principal: str = "a"
) -> list[VerdictRow]:
    """Three instances of one object an image."""
    return [
        VerdictRow(
            InstanceKey("d", int(s), i // 3, 5, i % 3),
            principal,
            gripper,
            Verdict(bool(a), float(a), "why"),
            np.eye(4),
        )
        for i, (s, a) in enumerate(zip(scene, attempt, strict=True))
    ]


def outcomes(scene: np.ndarray, success: np.ndarray, estimator: str = "a") -> pl.DataFrame:
    table = verdict_table(verdicts(scene, success, principal=estimator))
    return table.with_columns(success=table["attempt"].cast(int))


def some(seed: int, n: int = 400, scenes: int = 20) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    scene = rng.integers(scenes, size=n)
    lucky = rng.normal(size=scenes)[scene]
    success = rng.normal(size=n) + lucky > -0.3
    return scene, rng.normal(size=n) + success > 0.7, success


def test_rates_are_counts() -> None:
    scene, attempt, success = some(0)
    found = score_verdicts(verdicts(scene, attempt), outcomes(scene, success))
    assert (found.n, found.attempts, found.scenes, found.untried) == (400, attempt.sum(), 20, 0)
    assert found.always.value == pytest.approx(success.mean())
    assert found.attempt_rate.value == pytest.approx(attempt.mean())
    assert found.following is not None and found.gain is not None
    assert found.following.value == pytest.approx(success[attempt].mean())
    assert found.gain.value == pytest.approx(success[attempt].mean() - success.mean())


def test_intervals_are_those_of_rows_repeated_with_their_scenes() -> None:
    scene, attempt, success = some(1)
    found = score_verdicts(verdicts(scene, attempt), outcomes(scene, success), draws=4000)
    rng = np.random.default_rng(5)
    rows = [np.flatnonzero(scene == s) for s in np.unique(scene)]
    drawn = []
    for _ in range(4000):
        i = np.concatenate([rows[k] for k in rng.integers(len(rows), size=len(rows))])
        drawn.append((success[i].mean(), success[i][attempt[i]].mean(), attempt[i].mean()))
    always, following, rate = np.array(drawn).T
    for mine, other in (
        (found.always, always),
        (found.following, following),
        (found.attempt_rate, rate),
        (found.gain, following - always),
    ):
        assert mine is not None
        assert [mine.low, mine.high] == pytest.approx(np.percentile(other, (2.5, 97.5)), abs=0.012)


def test_order_of_rows_and_other_outcomes_do_not_matter() -> None:
    scene, attempt, success = some(2)
    mine, theirs = verdicts(scene, attempt), outcomes(scene, success)
    whole = score_verdicts(mine, theirs)
    shuffled = theirs.sample(fraction=1.0, shuffle=True, seed=1)
    more = pl.concat([shuffled, outcomes(scene, ~success, "b")])
    assert score_verdicts(mine[::-1], more) == whole


def test_what_cannot_be_said_is_not_said() -> None:
    scene, attempt, success = some(3)
    none = score_verdicts(verdicts(scene, attempt & False), outcomes(scene, success))
    assert none.following is None and none.gain is None and none.attempts == 0
    one = score_verdicts(verdicts(scene * 0, attempt), outcomes(scene * 0, success))
    assert math.isnan(one.always.low)
    assert one.as_dict()["always"] == {"value": success.mean(), "low": None, "high": None}
    assert str(one.always) == f"{success.mean():.3f}"
    half = outcomes(scene, success).filter(pl.col("im_id") % 2 == 0)
    assert score_verdicts(verdicts(scene, attempt), half).untried == 400 - len(half)


def test_what_has_no_outcomes_is_named() -> None:
    scene, attempt, success = some(4)
    both = pl.concat([outcomes(scene, success, name) for name in "ab"])
    with pytest.raises(UnknownNameError, match="estimator 'c'; known: a, b"):
        score_verdicts(verdicts(scene, attempt, principal="c"), both)
    with pytest.raises(UnknownNameError, match="gripper 'claw'"):
        score_verdicts(verdicts(scene, attempt, "claw"), both)
    with pytest.raises(UnknownNameError, match="dataset 'd'; known: e"):
        score_verdicts(verdicts(scene, attempt), both.with_columns(dataset=pl.lit("e")))
    with pytest.raises(MismatchError, match="no outcome is about any of the verdicts"):
        score_verdicts(verdicts(scene + 99, attempt), both)


def test_filtered_and_sorted_verdicts_keep_their_outcomes() -> None:
    """The rank of a row in the file says nothing about its instance."""
    scene, _, success = some(5)
    mine, theirs = verdicts(scene, success), outcomes(scene, success)
    assert score_verdicts(mine, theirs).following.value == 1.0  # type: ignore[union-attr]
    attempts = [row for row in mine if row.verdict.attempt][::-1]
    only = score_verdicts(attempts, theirs)
    assert (only.always.value, only.n) == (1.0, success.sum())


def test_outcomes_that_could_be_of_several_instances_are_refused() -> None:
    scene, attempt, success = some(6)
    unstated = outcomes(scene, success).drop("est_id").unique(["scene_id", "im_id"])
    with pytest.raises(
        MismatchError, match="several instances of d-5, but the outcomes have no co"
    ):
        score_verdicts(verdicts(scene, attempt), unstated)


def test_verdicts_of_two_datasets_with_the_same_numbers_are_told_apart() -> None:
    scene, attempt, success = some(7)
    mine = verdicts(scene, attempt)
    other = [dataclasses.replace(row, key=row.key._replace(dataset="e")) for row in mine]
    theirs = outcomes(scene, success)
    both = pl.concat(
        [theirs, theirs.with_columns(dataset=pl.lit("e"), success=1 - pl.col("success"))]
    )
    assert score_verdicts(mine + other, both).always.value == 0.5
    assert score_verdicts(mine, both).always.value == pytest.approx(success.mean())


def test_no_outcomes_at_all() -> None:
    scene, attempt, success = some(0)
    none = outcomes(scene, success).head(0)
    with pytest.raises(InputError, match="there are no outcomes to score by"):
        score_verdicts(verdicts(scene, attempt), none)


def test_a_principal_without_outcomes_is_counted() -> None:
    scene, attempt, success = some(0)
    said = verdicts(scene, attempt)
    said[7] = dataclasses.replace(said[7], principal="b")
    with pytest.raises(UnknownNameError, match="1 of 400 verdicts are of 'b': try or simulate"):
        score_verdicts(said, outcomes(scene, success))


def test_few_attempts_that_all_succeed_are_not_certain_to() -> None:
    scene = np.repeat(np.arange(10), 6)
    success = np.arange(60) % 3 == 0
    attempt = np.isin(np.arange(60), [0, 21, 42])
    found = score_verdicts(verdicts(scene, attempt), outcomes(scene, success))
    assert found.following is not None and found.gain is not None
    assert found.following.value == 1.0 and found.following.low < 0.4
    assert found.gain.value == pytest.approx(2 / 3) and found.gain.low < 0.1
    everything = score_verdicts(verdicts(scene, success | True), outcomes(scene, success | True))
    assert everything.gain is not None and everything.gain.ends == [0.0, 0.0]
