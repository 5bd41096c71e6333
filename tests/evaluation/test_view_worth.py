"""What further views are worth: differences and intervals, against computations by hand."""

from __future__ import annotations

import json

import numpy as np
import pytest

from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.principal_views import Seen, ViewForecasts
from graspcast.evaluation.view_worth import ViewWorth, worth_of_views

RNG = np.random.default_rng(3)
SCENES = np.repeat([f"s{i}" for i in range(8)], 15)
SUCCESS = RNG.random(120) < 0.6
DRAWS, SEED = 200, 4
SKILL: dict[Seen, float] = {
    (("a", "b", "c"), 1): 0.9,
    (("a", "b"), 1): 0.3,
    (("a", "c"), 1): 0.8,
    (("a",), 2): 1.6,
    (("a", "b", "c"), 2): 1.8,
    (("a",), 3): 0.1,
    (("a", "b", "c"), 3): 2.4,
}


def forecasts(skill: float) -> Forecasts:
    logit = skill * (2 * SUCCESS - 1.0) + RNG.normal(size=len(SUCCESS))
    given = (1 / (1 + np.exp(-logit)), SUCCESS, np.full(len(SUCCESS), "d-1"), SCENES)
    return Forecasts("unseen_scenes", "m", "a", "parallel", *given)


FORECASTS = {seen: forecasts(skill) for seen, skill in SKILL.items()}


@pytest.fixture(scope="module")
def worth() -> ViewWorth:
    return worth_of_views(ViewForecasts(FORECASTS, 9, {2: 4, 3: 0}), DRAWS, SEED)


def brier(seen: Seen, rows: np.ndarray) -> float:
    return float(np.mean((FORECASTS[seen].probability[rows] - SUCCESS[rows]) ** 2))


def aurc(seen: Seen) -> float:
    order = np.argsort(-FORECASTS[seen].probability)
    failed = np.cumsum(~SUCCESS[order])
    return float(np.mean(failed / np.arange(1, len(order) + 1)))


def test_scores_and_counts(worth: ViewWorth) -> None:
    assert (worth.principal, worth.estimators) == ("a", ("a", "b", "c"))
    assert (worth.n, worth.scenes, worth.without_views) == (120, 8, 9)
    assert worth.success_rate == pytest.approx(SUCCESS.mean())
    everything = np.arange(120)
    for seen in SKILL:
        assert worth.scores[seen]["brier"] == pytest.approx(brier(seen, everything))
        assert worth.scores[seen]["aurc"] == pytest.approx(aurc(seen))


def test_differences_are_paired_by_draws_of_whole_scenes(worth: ViewWorth) -> None:
    gain = worth.instead[2]
    # The best second estimator is the rival, not the first one.
    assert gain.better == (("a",), 2) and gain.worse == (("a", "c"), 1)
    counts = np.random.default_rng(SEED).multinomial(8, np.full(8, 1 / 8), size=DRAWS)
    differences = []
    for count in counts:
        rows = np.repeat(np.arange(120), np.repeat(count, 15))
        differences.append(brier(gain.worse, rows) - brier(gain.better, rows))
    value = brier(gain.worse, np.arange(120)) - brier(gain.better, np.arange(120))
    found = gain.improvement["brier"]
    assert found.value == pytest.approx(value)
    ends = np.quantile(differences, [0.025, 0.975]) - (np.mean(differences) - value)
    assert [found.low, found.high] == pytest.approx(ends.tolist())
    assert gain.improvement["aurc"].value == pytest.approx(aurc(gain.worse) - aurc(gain.better))


def test_what_is_compared_with_what(worth: ViewWorth) -> None:
    everyone, alone = ("a", "b", "c"), ("a",)
    assert worth.instead[3].better == (alone, 3) and worth.instead[3].worse == (everyone, 1)
    assert worth.instead[3].improvement["aurc"].high < 0 < worth.instead[2].improvement["aurc"].low
    pairs = {v: (g.better, g.worse) for v, g in worth.further.items()}
    assert pairs == {v: ((everyone, v), (everyone, v - 1)) for v in (2, 3)}
    pairs = {v: (g.better, g.worse) for v, g in worth.others.items()}
    assert pairs == {v: ((everyone, v), (alone, v)) for v in (2, 3)}
    over = worth.over_one_view[alone, 2]["aurc"].value
    assert over == pytest.approx(aurc((everyone, 1)) - aurc((alone, 2)))


def test_of_two_estimators_a_third_view_has_no_rival() -> None:
    two = {seen: f for seen, f in FORECASTS.items() if "c" not in seen[0]}
    two |= {(("a", "b"), v): FORECASTS[("a", "b", "c"), v] for v in (2, 3)}
    worth = worth_of_views(ViewForecasts(two, 0, {}), 5, 0)
    assert set(worth.instead) == {2} and worth.instead[2].worse == (("a", "b"), 1)
    assert set(worth.further) == set(worth.others) == {2, 3}


def test_json(worth: ViewWorth) -> None:
    plain = json.loads(json.dumps(worth.as_dict()))
    assert plain["contradicted"] == {"2": 4, "3": 0}
    (alone,) = (f for f in plain["forecasts"] if f["estimators"] == ["a"] and f["views"] == 2)
    assert alone["scores"]["aurc"] == pytest.approx(aurc((("a",), 2)))
    assert plain["instead"]["2"]["worse"] == {"estimators": ["a", "c"], "views": 1}
    gain = plain["instead"]["2"]["improvement"]["aurc"]
    assert gain["low"] < gain["value"] < gain["high"]
