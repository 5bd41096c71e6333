"""Paired differences against plain scoring of repeated rows, and against a formula."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from graspcast.evaluation.bootstrap import draw_scenes
from graspcast.evaluation.paired_differences import (
    FORECAST_MEASURES,
    PRINCIPAL_MEASURES,
    bootstrap_scores,
    improvements,
    original_scores,
)
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.scores import score


def forecasts(probability: np.ndarray, success: np.ndarray, scenes: np.ndarray) -> Forecasts:
    objects = np.full(len(success), "made-1")
    return Forecasts("unseen_scenes", "m", "a", "parallel", probability, success, objects, scenes)


@pytest.mark.slow
def test_intervals_are_those_of_the_same_repeated_rows_on_both_sides() -> None:
    rng = np.random.default_rng(1)
    scenes = np.repeat(["x", "y", "z"], [7, 11, 9])
    success = rng.random(27) < 0.5
    success[scenes == "z"] = True  # a draw of nothing else has no AUROC
    good = np.clip(0.5 * success + rng.integers(6, size=27) / 10, 0, 1)
    bad = rng.integers(6, size=27) / 5
    measures = tuple(dict.fromkeys((*FORECAST_MEASURES, *PRINCIPAL_MEASURES)))
    one, other = (
        bootstrap_scores(forecasts(p, success, scenes), measures, 60, seed=4) for p in (good, bad)
    )
    found = improvements(one, other)

    names = ["x", "y", "z"]
    rows = [
        np.concatenate([np.flatnonzero(scenes == names[i]) for i in np.repeat([0, 1, 2], draw)])
        for draw in draw_scenes(names, 60, 4)
    ]
    together = np.zeros(27)

    def difference(rows: np.ndarray, name: str) -> float:
        a, b = (getattr(score(p[rows], success[rows], together[rows]), name) for p in (good, bad))
        return b - a if name in ("aurc", "brier") else a - b

    for name in measures:
        drawn = np.array([difference(r, name) for r in rows])
        value = difference(np.arange(27), name)
        ends = np.nanpercentile(drawn, [2.5, 97.5]) - (np.nanmean(drawn) - value)
        assert np.isnan(drawn).any() == (name == "auroc")
        gain = found[name]
        assert_allclose((gain.value, gain.low, gain.high), (value, *ends), atol=1e-12, err_msg=name)
        plain = getattr(score(good, success, together), name)
        assert original_scores(one)[name] == pytest.approx(plain, abs=1e-12)


def test_what_differs_nowhere_differs_in_no_draw() -> None:
    rng = np.random.default_rng(2)
    p = rng.random(40)
    same = forecasts(p, rng.random(40) < p, np.repeat(list("wxyz"), 10))
    one, other = (bootstrap_scores(same, FORECAST_MEASURES, 50, seed=0) for _ in range(2))
    for gain in improvements(one, other).values():
        assert (gain.value, gain.low, gain.high) == (0, 0, 0)


def test_intervals_are_those_of_a_mean_over_scenes() -> None:
    """The Brier score is a mean: its standard error over equal scenes has a formula."""
    rng = np.random.default_rng(3)
    scenes, each = 40, 5
    groups = np.repeat(np.arange(scenes), each).astype(str)
    success = rng.random(scenes * each) < 0.6
    shift = np.repeat(rng.normal(0, 0.1, scenes), each)
    one = np.clip(0.6 + shift + rng.normal(0, 0.05, len(shift)), 0, 1)
    other = np.full(len(one), 0.5)
    both = (forecasts(p, success, groups) for p in (one, other))
    gain = improvements(*(bootstrap_scores(f, ("brier",), 500, seed=0) for f in both))["brier"]
    difference = ((other - success) ** 2 - (one - success) ** 2).reshape(scenes, each).mean(axis=1)
    error = difference.std(ddof=1) / np.sqrt(scenes)
    assert gain.value == pytest.approx(difference.mean())
    assert_allclose(
        [gain.low, gain.high], difference.mean() + 1.96 * error * np.array([-1, 1]), atol=error / 4
    )


def test_one_scene_has_no_interval() -> None:
    p, success = np.array([0.2, 0.6, 0.7]), np.array([False, True, True])
    both = (forecasts(q, success, np.full(3, "x")) for q in (p, 1 - p))
    gain = improvements(*(bootstrap_scores(f, FORECAST_MEASURES, 10, seed=0) for f in both))[
        "auroc"
    ]
    assert gain.value == 1.0
    assert np.isnan([gain.low, gain.high]).all()
    assert not gain.excludes_zero
