"""Scores of predictions: their keys, and their intervals against plain reindexing."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import numpy as np
import pytest

from graspcast.errors import InputError, MismatchError
from graspcast.evaluation.bootstrap import Bootstrap, draw_scenes
from graspcast.evaluation.net_benefit import Costs
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.report import MEASURES, SCORES, evaluate
from graspcast.evaluation.scores import score

PRINCIPALS = ("epos", "gdrnpp")
GRIPPERS = ("parallel", "underactuated")
METHODS = ("threshold", "MLP", "MLP-O", "good")
SCENES = [f"d/{i}" for i in range(6)]
BOOTSTRAP = Bootstrap(draws=40, seed=3)


def forecasts(method: str, principal: str, gripper: str, protocol: str) -> Forecasts:
    """All methods see the same grasps; ``good`` knows more about them."""
    rng = np.random.default_rng(10 * PRINCIPALS.index(principal) + GRIPPERS.index(gripper))
    n = 90
    chance = rng.random(n)
    success = rng.random(n) < chance
    objects = np.array([f"d-{i}" for i in rng.integers(3, size=n)])
    scenes = np.array(SCENES)[rng.integers(len(SCENES), size=n)]
    own = np.random.default_rng(METHODS.index(method))
    share = 1.0 if method == "good" else 0.3
    probability = np.clip(share * chance + (1 - share) * own.random(n), 0, 1)
    return Forecasts(protocol, method, principal, gripper, probability, success, objects, scenes)


def all_forecasts(protocols: tuple[str, ...] = ("unseen_scenes",)) -> list[Forecasts]:
    return [
        forecasts(m, e, g, p)
        for p in protocols
        for m in METHODS
        for e in PRINCIPALS
        for g in GRIPPERS
    ]


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    return evaluate(all_forecasts(("random_split", "unseen_scenes")), bootstrap=BOOTSTRAP)


def test_the_keys_and_plain_numbers(found: dict[str, Any]) -> None:
    again = json.loads(json.dumps(found, allow_nan=False))
    for protocol in ("random_split", "unseen_scenes"):
        for method in METHODS:
            for gripper in GRIPPERS:
                figures = again["evaluate"][protocol][method][gripper]
                for measure in MEASURES:
                    low, high = figures[f"{measure}_interval"]
                    assert isinstance(figures[measure], float)
                    assert low <= figures[measure] <= high
                assert figures["by_principal"].keys() == set(PRINCIPALS)
                others = {"threshold", "MLP", "MLP-O"} - {method}
                assert figures["differences"].keys() == others


def test_numbers_are_means_over_principals_of_the_scores(found: dict[str, Any]) -> None:
    for method in METHODS:
        scores = []
        for principal in PRINCIPALS:
            f = forecasts(method, principal, "parallel", "unseen_scenes")
            scores.append(score(f.probability, f.success, f.objects))
        figures = found["evaluate"]["unseen_scenes"][method]["parallel"]
        for name in SCORES:
            assert figures[name] == pytest.approx(np.mean([getattr(s, name) for s in scores]))
        assert figures["by_principal"]["gdrnpp"]["accuracy"] == scores[1].accuracy


@pytest.mark.slow
def test_intervals_and_differences_are_those_of_plain_reindexing(found: dict[str, Any]) -> None:
    """The same draws, but every row looked up, and one draw for methods and principals alike."""
    counts = draw_scenes(SCENES, BOOTSTRAP.draws, BOOTSTRAP.seed)
    costs = Costs()

    def by_hand(method: str, principal: str, names: np.ndarray) -> list[float]:
        f = forecasts(method, principal, "underactuated", "unseen_scenes")
        rows = np.concatenate([np.flatnonzero(f.scenes == name) for name in names])
        p, s = f.probability[rows], f.success[rows]
        scores = score(p, s, f.objects[rows])
        return [
            *(getattr(scores, name) for name in SCORES),
            costs.net_benefit_of_forecast(p, s).mean(),
        ]

    drawn = {
        method: [
            np.mean([by_hand(method, e, np.repeat(SCENES, draw)) for e in PRINCIPALS], axis=0)
            for draw in counts
        ]
        for method in ("good", "threshold")
    }
    good, threshold = np.array(drawn["good"]), np.array(drawn["threshold"])
    figures = found["evaluate"]["unseen_scenes"]["good"]["underactuated"]
    for k, measure in enumerate((*SCORES, "net_benefit")):
        bias = good[:, k].mean() - figures[measure]
        expected = np.quantile(good[:, k], [0.025, 0.975]) - bias
        assert figures[f"{measure}_interval"] == pytest.approx(np.clip(expected, -3, 1), abs=1e-9)
        against = figures["differences"]["threshold"][measure]
        gap = good[:, k] - threshold[:, k]
        expected = np.quantile(gap, [0.025, 0.975]) - (gap.mean() - against["difference"])
        assert against["interval"] == pytest.approx(expected, abs=1e-9)


def test_a_method_differs_from_itself_by_nothing_in_every_draw() -> None:
    every = [f for f in all_forecasts() if f.method == "threshold"]
    every += [dataclasses.replace(f, method="copy") for f in every]
    found = evaluate(every, bootstrap=BOOTSTRAP)
    for gripper in GRIPPERS:
        differences = found["evaluate"]["unseen_scenes"]["copy"][gripper]["differences"]
        for measure in MEASURES:
            assert differences["threshold"][measure] == {"difference": 0.0, "interval": [0.0, 0.0]}


def test_knowing_more_is_better_and_pairing_shows_it(found: dict[str, Any]) -> None:
    for gripper in GRIPPERS:
        good = found["evaluate"]["unseen_scenes"]["good"][gripper]
        for measure, sign in (("auroc", 1), ("brier", -1), ("aurc", -1), ("net_benefit", 1)):
            gap = good["differences"]["threshold"][measure]
            assert sign * gap["difference"] > 0
            assert min(sign * end for end in gap["interval"]) > 0, measure
        reference = found["reference_net_benefit"]["unseen_scenes"][gripper]
        assert reference["never"] == pytest.approx(-0.2)
        assert reference["always"] < good["net_benefit"] < reference["perfect"]


@pytest.mark.slow
def test_the_interval_covers_the_mean_of_scenes_as_often_as_it_says() -> None:
    """Scenes differ by more than trials do; an interval over trials would be far too narrow."""
    rng = np.random.default_rng(0)
    hits = 0
    worlds, scenes, each = 100, 40, 8
    for _ in range(worlds):
        rate = np.repeat(rng.choice([0.1, 0.9], scenes), each)
        success = rng.random(len(rate)) < rate
        f = Forecasts(
            "unseen_scenes",
            "m",
            "epos",
            "parallel",
            np.ones(len(rate)),
            success,
            np.full(len(rate), "d-1"),
            np.repeat([f"d/{i}" for i in range(scenes)], each),
        )
        figures = evaluate([f], bootstrap=Bootstrap(draws=100))["evaluate"]["unseen_scenes"]["m"]
        low, high = figures["parallel"]["accuracy_interval"]
        hits += low <= 0.5 <= high
    assert 0.87 <= hits / worlds <= 1.0


def test_an_undefined_score_is_null() -> None:
    every = [f for f in all_forecasts() if f.method == "good" and f.gripper == "parallel"]
    every = [dataclasses.replace(f, success=np.ones_like(f.success)) for f in every]
    found = evaluate(every, bootstrap=BOOTSTRAP)
    figures = found["evaluate"]["unseen_scenes"]["good"]["parallel"]
    assert figures["auroc"] is None
    assert figures["auroc_interval"] is None
    json.dumps(found, allow_nan=False)


def test_what_cannot_be_compared_is_refused() -> None:
    every = all_forecasts()
    with pytest.raises(InputError, match="there are no forecasts"):
        evaluate([])
    with pytest.raises(InputError, match="two forecasts of threshold, epos, parallel"):
        evaluate([*every, every[0]])
    other = dataclasses.replace(every[-1], success=~every[-1].success)
    with pytest.raises(MismatchError, match="good and threshold were evaluated on different"):
        evaluate([*every[:-1], other])
    with pytest.raises(MismatchError, match="good has no forecasts for gdrnpp"):
        evaluate(every[:-1])


def test_progress_ends_with_all_protocols() -> None:
    seen: list[tuple[float, str]] = []
    every = all_forecasts(("random_split", "unseen_scenes"))
    evaluate(every, bootstrap=BOOTSTRAP, progress=lambda *done: seen.append(done))
    assert [share for share, _ in seen] == [0.0, 0.5, 1.0]
    assert "unseen scenes" in seen[1][1]
