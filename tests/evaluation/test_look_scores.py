"""Looks against outcomes: which stage counts for whom, rates by hand, and looks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import InstanceKey
from graspcast.evaluation.look_scores import Stage, check_covered, score_looks, stages_of
from graspcast.evaluation.verdict_scores import verdict_table
from graspcast.forecasting.verdict import InstanceLooks, Verdict, VerdictRow
from graspcast.views.next_look import NextLook

AHEAD = np.array([0.0, 0.0, 1.0])
AGAIN = NextLook(AHEAD, AHEAD, AHEAD, 0.01, 1.0, None)


def stage(said: str, views: str, success: str, est_id: int = 0, guide: str = "a") -> Stage:
    """Verdicts by letter (a: attempt, l: look again, n: abstain), and outcomes by digit."""
    rows = [
        VerdictRow(
            InstanceKey("d", i // 2, 0, i % 2 + 1, est_id),
            guide,
            "hand",
            Verdict(letter == "a", 0.5, "why", look=AGAIN if letter == "l" else None),
            np.eye(4),
            views=int(number),
        )
        for i, (letter, number) in enumerate(zip(said, views, strict=True))
    ]
    held = pl.Series("success", [None if c == "-" else int(c) for c in success], dtype=pl.Int64)
    outcomes = verdict_table(rows).with_columns(held).drop_nulls("success")
    return Stage(rows, outcomes.drop("attempt", "probability"))


def test_each_policy_counts_its_own_stage() -> None:
    found = score_looks(
        [
            stage("allnll", "111111", "100000"),
            stage("aaaall", "212222", "011111", guide="f"),
            stage("anaaal", "313233", "011101", guide="f"),
        ]
    )
    always, one, again, three, blind = found.policies
    assert (found.n, found.scenes) == (6, 3)
    assert always.success is not None and always.success.value == pytest.approx(1 / 6)
    assert (always.attempts, always.looks) == (6, 1)
    assert one.success is not None and one.success.value == 1
    assert (one.attempts, one.looks) == (1, 1)
    # First look; second look twice; abstained at once; third look; still in doubt at the end.
    assert again.attempts == 4 and again.success is not None
    assert again.success.value == pytest.approx(3 / 4)
    assert again.looks == pytest.approx((1 + 1 + 2 + 1 + 3 + 3) / 6)
    assert three.attempts == 4 and three.success is not None
    assert three.success.value == pytest.approx(2 / 4)
    assert blind.success is not None and blind.success.value == pytest.approx(4 / 6)
    assert "three" in three.name and again.attempt_rate.value == pytest.approx(4 / 6)
    assert always.attempt_rate.low == always.attempt_rate.high == 1


def test_an_instance_counts_if_it_was_tried_after_each_look() -> None:
    found = score_looks([stage("aaaa", "1111", "1-01"), stage("aaaa", "2222", "11-1")])
    assert (found.n, found.scenes) == (2, 2)
    assert "two" in found.policies[3].name
    with pytest.raises(MismatchError, match="no instance has an outcome after each look"):
        score_looks([stage("aa", "11", "1-"), stage("aa", "22", "-1")])


def test_no_attempt_has_no_success_rate() -> None:
    found = score_looks([stage("ll", "11", "11"), stage("nn", "22", "11")])
    assert found.policies[1].success is None and found.policies[2].success is None
    assert found.policies[2].attempt_rate.value == 0


def test_stages_of_different_instances_are_refused() -> None:
    with pytest.raises(MismatchError, match="different instances"):
        score_looks([stage("aaaa", "1111", "1111"), stage("aa", "22", "11")])
    # Each guide numbers its estimates by itself.
    score_looks([stage("aa", "11", "11"), stage("aa", "22", "11", est_id=1)])


def looked(*said: str, images: str, guides: tuple[str, ...] = ("a", "f2", "f3")) -> InstanceLooks:
    """Verdicts on one instance by letter, as many as it has images."""
    rows = [
        stage(letter, "1", "1", guide=guide).verdicts[0]
        for letter, guide in zip(said, guides, strict=False)
    ]
    return InstanceLooks(tuple(rows[: int(images)]), 1)


def test_an_instance_with_fewer_images_keeps_its_last_verdict() -> None:
    looks = [
        replace_place(looked("l", "l", "a", images="3"), 0),
        replace_place(looked("l", "a", "n", images="2"), 1),
        replace_place(looked("l", images="1"), 2),
    ]
    outcomes = pl.concat(
        verdict_table(list(each.rows)).with_columns(success=pl.lit(1)) for each in looks
    ).drop("attempt", "probability")
    stages = stages_of(looks, outcomes)
    said = [[str(row.verdict) for row in s.verdicts] for s in stages]
    assert said[1] == ["look again", "attempt", "look again"]
    assert said[2] == ["attempt", "attempt", "look again"]
    assert [s.looks.tolist() for s in stages if s.looks is not None][2] == [3, 2, 1]
    found = score_looks(stages)
    assert (found.policies[2].attempts, found.policies[2].looks) == (2, 2.0)
    some = outcomes.filter(~((pl.col("estimator") == "f3") & (pl.col("scene_id") == 0)))
    with pytest.raises(MismatchError, match="no outcomes of f3 on d"):
        stages_of(looks, some)
    scored = score_looks(stages_of(looks[1:], some))
    assert (scored.n, scored.untried) == (2, 0)
    assert scored.as_dict()["policies"][0]["success"]["value"] == 1.0
    with pytest.raises(InputError, match="no verdicts"):
        stages_of([], outcomes)


def replace_place(looks: InstanceLooks, scene: int) -> InstanceLooks:
    """Return the same verdicts on an instance of another scene."""
    rows = (replace(row, key=row.key._replace(scene_id=scene)) for row in looks.rows)
    return replace(looks, rows=tuple(rows))


def test_guides_without_outcomes_are_named_with_what_makes_them() -> None:
    given = stage("aa", "11", "11", guide="fused2")
    check_covered(given.verdicts, given.outcomes)
    with pytest.raises(MismatchError, match=r"fused2 are trials .* fused from up to 2 views"):
        check_covered(given.verdicts, stage("aa", "11", "11").outcomes)
