"""Scores of draws of scenes against plain scoring of rows that are repeated."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from sklearn.metrics import roc_auc_score

from graspcast.evaluation.bootstrap import (
    Interval,
    ResampledScores,
    draw_scenes,
    original_and_draws,
)
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.scores import BINS, bin_of, score

SCENES = ["s0", "s1", "s2", "s3"]
MEASURES = (
    *("accuracy", "auroc", "brier", "ece", "aurc"),
    *("success_at_50", "success_at_70", "success_at_90", "success"),
)


def forecasts(seed: int, n: int = 60, *, levels: int | None = 7) -> Forecasts:
    """Few levels make ties common."""
    rng = np.random.default_rng(seed)
    probability = rng.random(n) if levels is None else rng.integers(levels, size=n) / (levels - 1)
    return Forecasts(
        "random_split",
        "m",
        "a",
        "p",
        probability,
        rng.random(n) < 0.2 + 0.6 * probability,
        np.array([f"d-{i}" for i in rng.integers(3, size=n)]),
        np.array(SCENES)[rng.integers(len(SCENES), size=n)],
    )


def repeated(f: Forecasts, counts: np.ndarray) -> np.ndarray:
    """The rows of a draw, by plain indexing."""
    rows = [np.flatnonzero(f.scenes == s) for s, c in zip(SCENES, counts, strict=True) if c]
    times = [c for c in counts if c]
    return np.concatenate([np.tile(r, c) for r, c in zip(rows, times, strict=True)])


@settings(max_examples=50)
@given(
    st.integers(0, 10_000),
    st.integers(1, 60),
    st.lists(st.integers(0, 3), min_size=4, max_size=4).filter(any),
    st.sampled_from([2, 7, None]),
)
def test_every_score_is_that_of_repeated_rows(
    seed: int, n: int, counts: list[int], levels: int | None
) -> None:
    """Of any size, since the share attempted is rounded to whole rows."""
    f = forecasts(seed, n, levels=levels)
    draw = np.array([counts])
    rows = repeated(f, draw[0])
    assume(len(rows))
    expected = score(f.probability[rows], f.success[rows], f.objects[rows])
    again = ResampledScores(f, SCENES, draw)
    for name in MEASURES:
        value = getattr(again, name)()
        assert value.shape == (1,)
        assert value[0] == pytest.approx(getattr(expected, name), abs=1e-12, nan_ok=True), name
    assert again.mean(f.probability)[0] == pytest.approx(f.probability[rows].mean())


def test_auroc_is_scikit_learns_with_repeated_rows_and_with_weights() -> None:
    f = forecasts(3, n=200)
    counts = draw_scenes(SCENES, 20, seed=1)
    found = ResampledScores(f, SCENES, counts).auroc()
    number = np.array([SCENES.index(s) for s in f.scenes])
    for draw, value in zip(counts, found, strict=True):
        rows = repeated(f, draw)
        assert value == pytest.approx(roc_auc_score(f.success[rows], f.probability[rows]))
        weight = draw[number]
        assert value == pytest.approx(
            roc_auc_score(f.success, f.probability, sample_weight=weight), abs=1e-12
        )


def test_success_in_bins_is_a_loop_over_rows() -> None:
    f = forecasts(4)
    draw = np.array([[1, 0, 2, 1]])
    rows = repeated(f, draw[0])
    number = bin_of(f.probability[rows])
    found = ResampledScores(f, SCENES, draw).success_in_bins()[0]
    for k in range(BINS):
        mine = f.success[rows][number == k]
        assert found[k] == pytest.approx(mine.mean() if len(mine) else np.nan, nan_ok=True)


def test_a_draw_of_nothing_has_no_scores() -> None:
    f = forecasts(0)
    again = ResampledScores(f, SCENES, np.zeros((1, 4), np.int64))
    for name in MEASURES:
        assert np.isnan(getattr(again, name)()).all(), name


def test_draws_are_of_as_many_scenes_and_repeatable() -> None:
    counts = draw_scenes(SCENES, 4000, seed=2)
    assert counts.shape == (4000, 4)
    assert (counts.sum(axis=1) == 4).all()
    assert (counts == draw_scenes(SCENES, 4000, seed=2)).all()
    assert (counts != draw_scenes(SCENES, 4000, seed=3)).any()
    # Each scene once on average, and absent in (3/4)^4 of the draws.
    assert_allclose(counts.mean(axis=0), 1, atol=0.06)
    assert_allclose((counts == 0).mean(axis=0), 0.75**4, atol=0.03)


def test_an_interval_of_a_mean_is_that_of_the_normal_distribution() -> None:
    draws = np.random.default_rng(0).normal(0.4, 0.02, 20_000)
    found = Interval.of(0.4, draws)
    assert (found.low, found.high) == pytest.approx(
        (0.4 - 1.96 * 0.02, 0.4 + 1.96 * 0.02), abs=1e-3
    )
    assert found.excludes_zero
    wider = Interval.of(0.4, draws, confidence=0.99)
    assert wider.low == pytest.approx(0.4 - 2.576 * 0.02, abs=2e-3)


def test_an_interval_is_corrected_for_bias_and_clipped() -> None:
    draws = np.random.default_rng(0).normal(0.2, 0.01, 4000)
    biased = Interval.of(0.1, draws)
    centred = Interval.of(0.1, draws - draws.mean() + 0.1)
    assert (biased.low, biased.high) == pytest.approx((centred.low, centred.high), abs=1e-12)
    assert Interval.of(0.005, draws, (0.0, 1.0)).low == 0.0


def test_undefined_draws_are_left_out() -> None:
    draws = np.array([0.1, np.nan, 0.2, 0.3])
    assert Interval.of(0.2, draws) == Interval.of(0.2, draws[[0, 2, 3]])
    for undefined in (Interval.of(0.2, np.full(3, np.nan)), Interval.of(np.nan, draws)):
        assert undefined.ends is None
        assert not undefined.excludes_zero
    assert str(Interval.of(0.2, draws[:0])) == "0.200"
    assert f"{Interval(0.2, 0.1, 0.3):+}" == "+0.200 [+0.100, +0.300]"


def test_a_single_scene_is_not_resampled() -> None:
    assert original_and_draws(["s"], 10, 0).tolist() == [[1]]
    counts = original_and_draws(SCENES, 10, 4)
    assert (counts[0] == 1).all()
    assert (counts[1:] == draw_scenes(SCENES, 10, 4)).all()
