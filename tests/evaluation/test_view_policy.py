"""Policies on recorded looks, by hand."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest

from graspcast.evaluation.bootstrap import Bootstrap
from graspcast.evaluation.view_policy import expectation, policies, score_policies

NAN = np.nan
# Sure at once; sure after a second look; after a third; never; only one look recorded.
PROBABILITY = np.array(
    [[0.9, 0.5, 0.5, 0.5, 0.7], [0.1, 0.9, 0.6, 0.5, NAN], [0.1, 0.1, 0.8, 0.7, NAN]]
)
SUCCESS = np.array([[1, 0, 0, 0, 1], [1, 1, 0, 0, 1], [1, 1, 1, 1, 0]], dtype=bool)
EXPECTED = np.array([[0.9, 0.7, 0.7, 0.51, 0.9], [0.9, 0.9, NAN, 0.9, NAN]])


def attempted(name: str) -> list[bool]:
    return policies(PROBABILITY, SUCCESS, EXPECTED)[name][0].tolist()


def looks(name: str) -> list[int]:
    return policies(PROBABILITY, SUCCESS, EXPECTED)[name][1].tolist()


def test_one_look_attempts_where_it_is_sure() -> None:
    assert attempted("one look") == [True, False, False, False, False]
    assert looks("one look") == [1] * 5
    assert all(attempted("always attempt, one look"))


def test_looking_again_goes_on_only_while_in_doubt() -> None:
    assert attempted("look again, up to 2") == [True, True, False, False, False]
    assert looks("look again, up to 2") == [1, 2, 2, 2, 1]
    assert attempted("look again, up to 3") == [True, True, True, False, False]
    assert looks("look again, up to 3") == [1, 2, 3, 3, 1]


def test_a_look_that_does_not_pay_is_not_taken() -> None:
    assert looks("look again where it pays, up to 3") == [1, 2, 3, 1, 1]


def test_always_looking_uses_the_last_forecast_and_its_outcome() -> None:
    found = policies(PROBABILITY, SUCCESS, EXPECTED)["always 3 looks"]
    assert [x.tolist() for x in found] == [
        [False, False, True, False, False],
        [3, 3, 3, 3, 1],
        [True, True, True, True, True],
    ]


def table() -> pl.DataFrame:
    """Two instances of each of three scenes; the second one becomes sure at the second look."""
    rows = []
    for instance in range(6):
        sure = instance % 2 == 0
        common = {
            "alone": "",
            "gripper": "p",
            "instance": instance,
            "scene": str(instance // 2),
            "object": "d-1",
            "image": f"d/{instance // 2}/{instance}",
            "one_view": 0.9 if sure else 0.5,
        }
        for row, views, p in (("2 views", 2, 0.9), ("3 views", 3, 0.95)):
            for principal in ("a", "fused"):
                entry = {**common, "row": row, "principal": principal, "views": views}
                entry |= {"probability": p, "expected": 0.93}
                entry["success"] = instance != 1 if principal == "a" else None
                rows.append(entry)
        more = {"row": "one view", "principal": "fused", "views": 1, "probability": 0.7}
        rows.append({**common, **more, "success": None, "expected": 0.8})
    return pl.DataFrame(rows)


def test_policies_are_scored_with_intervals() -> None:
    found = score_policies(table(), bootstrap=Bootstrap(draws=50))
    assert list(found) == ["single view"]
    mine = found["single view"]["p"]
    assert mine["n"] == 6
    assert mine["one look"]["attempts"] == pytest.approx(0.5)
    assert mine["one look"]["success"] == 1
    again = mine["look again, up to 2"]
    assert (again["attempts"], again["looks"]) == (1.0, pytest.approx(1.5))
    assert again["success"] == pytest.approx(5 / 6)
    assert again["success_interval"][0] < 5 / 6 < again["success_interval"][1] + 1e-9


def trials(*names: str) -> pl.DataFrame:
    return pl.DataFrame(
        [
            {
                "estimator": name,
                "dataset": "d",
                "scene_id": i // 2,
                "im_id": i,
                "obj_id": 1,
                "est_id": 0,
                "gripper": "p",
                "success": int(name != "a" or i == 0),
            }
            for name in names
            for i in range(6)
        ]
    )


def test_a_campaign_of_fused_poses_scores_the_fused_pose() -> None:
    assert list(score_policies(table(), trials("a", "fused2"))) == ["single view"]
    found = score_policies(table(), trials("a", "fused2", "fused3"), bootstrap=Bootstrap(draws=50))
    single = found["a, own trials"]["p"]["always attempt, 3 looks"]
    fused = found["a, then fused, own trials"]["p"]["always attempt, 3 looks"]
    assert single["success"] == pytest.approx(1 / 6)
    assert fused["success"] == 1


def test_expected_forecasts_are_compared_with_the_next() -> None:
    first, second = expectation(table())
    assert (first["before"], first["expected"], first["after"]) == pytest.approx((0.7, 0.8, 0.9))
    assert first["calibration"] == pytest.approx(0.1)
    assert (second["looks"], second["n"]) == (2, 6)
