"""Scores against oracles that loop, and what must not change them."""

from __future__ import annotations

import json
from itertools import permutations
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from graspcast.errors import InputError
from graspcast.evaluation.scores import calibration_error, risk_coverage, score

# Few distinct probabilities, so that ties and edges of bins are common.
chances = st.one_of(st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0]), st.floats(0, 1))
rows = st.lists(st.tuples(chances, st.booleans()), min_size=1, max_size=30)
Rows = list[tuple[float, bool]]


def columns(given_rows: Rows) -> tuple[np.ndarray, np.ndarray]:
    probability, success = zip(*given_rows, strict=True)
    return np.array(probability, float), np.array(success, bool)


def naive_calibration_error(probability: np.ndarray, success: np.ndarray, bins: int) -> float:
    total = 0.0
    for k in range(bins):
        last = k == bins - 1
        mine = [
            i
            for i, p in enumerate(probability)
            if k <= p * bins < k + 1 or (last and p * bins >= bins)
        ]
        if mine:
            gap = np.mean(probability[mine]) - np.mean(success[mine])
            total += len(mine) / len(success) * abs(gap)
    return float(total)


@given(rows, st.sampled_from([1, 4, 15]))
def test_calibration_error_is_that_of_a_loop_over_bins(given_rows: Rows, bins: int) -> None:
    probability, success = columns(given_rows)
    expected = naive_calibration_error(probability, success, bins)
    assert calibration_error(probability, success, bins=bins) == pytest.approx(expected, abs=1e-12)


def test_calibration_error_by_hand() -> None:
    probability = np.array([0.9, 0.9, 0.9, 0.9, 0.1])
    success = np.array([True, True, False, False, False])
    # Four at 0.9 of which half succeed, one at 0.1 that fails.
    assert calibration_error(probability, success) == pytest.approx(0.8 * 0.4 + 0.2 * 0.1)


@given(st.lists(st.tuples(st.sampled_from([0.2, 0.5, 0.8]), st.booleans()), min_size=1, max_size=6))
def test_equal_probabilities_count_as_the_mean_over_their_orders(given_rows: Rows) -> None:
    probability, success = columns(given_rows)
    n = len(success)
    orders = [o for o in permutations(range(n)) if (np.diff(probability[list(o)]) <= 0).all()]
    failed = np.array([~success[list(o)] for o in orders])
    risks = np.cumsum(failed, axis=1) / np.arange(1, n + 1)
    curve = risk_coverage(probability, success)
    assert_allclose(curve.risk, risks.mean(axis=0), atol=1e-12)
    assert_allclose(curve.coverage, np.arange(1, n + 1) / n)
    assert curve.area == pytest.approx(risks.mean())


def test_the_best_and_the_worst_ranking() -> None:
    n, held = 50, 30
    success = np.arange(n) < held
    best = risk_coverage(np.linspace(1, 0, n), success)
    k = np.arange(1, n + 1)
    assert best.area == pytest.approx(np.mean(np.maximum(0, k - held) / k))
    worst = risk_coverage(np.linspace(0, 1, n), success)
    assert worst.area == pytest.approx(np.mean(np.minimum(k, n - held) / k))
    nothing_known = risk_coverage(np.full(n, 0.3), success)
    assert_allclose(nothing_known.risk, 1 - held / n)
    assert best.success_at(0.6) == 1.0
    assert best.success_at(1.0) == worst.success_at(1.0) == pytest.approx(held / n)
    assert worst.success_at(0.4) == 0.0
    assert worst.success_at(0.0) == 0.0  # one is attempted at least


@settings(max_examples=40)
@given(rows, st.randoms())
def test_the_order_of_samples_does_not_matter(given_rows: Rows, random: Random) -> None:
    probability, success = columns(given_rows)
    objects = np.array([f"d-{i % 3}" for i in range(len(success))])
    order = np.array(random.sample(range(len(success)), len(success)))
    once = score(probability, success, objects).as_dict()
    again = score(probability[order], success[order], objects[order]).as_dict()
    assert once.keys() == again.keys()
    for name, value in once.items():
        assert again[name] == (None if value is None else pytest.approx(value, abs=1e-12)), name


@settings(max_examples=40)
@given(rows)
def test_only_the_ranking_matters_to_auroc_and_risk(given_rows: Rows) -> None:
    probability, success = columns(given_rows)
    _, rank = np.unique(probability, return_inverse=True)
    ranked = rank / (rank.max() + 1)
    objects = np.full(len(success), "d-1")
    one, two = (score(p, success, objects).as_dict() for p in (probability, ranked))
    for name in ("auroc", "aurc", "success_at_50", "success_at_70", "success_at_90", "majority"):
        assert one[name] == two[name], name


@settings(max_examples=40)
@given(rows)
def test_auroc_and_brier_by_their_definitions(given_rows: Rows) -> None:
    probability, success = columns(given_rows)
    found = score(probability, success, np.full(len(success), "d-1"))
    assert found.brier == pytest.approx(np.mean((probability - success) ** 2), abs=1e-12)
    held, failed = probability[success], probability[~success]
    if len(held) and len(failed):
        above = (held[:, None] > failed).mean() + 0.5 * (held[:, None] == failed).mean()
        assert found.auroc == pytest.approx(above, abs=1e-12)
    else:
        assert np.isnan(found.auroc)


def test_accuracy_over_objects_and_over_samples_by_hand() -> None:
    objects = np.array(["d-1"] * 4 + ["d-2"])
    probability = np.array([0.9, 0.5, 0.1, 0.2, 0.7])
    success = np.array([True, True, False, True, False])
    found = score(probability, success, objects)
    # d-1: three of four right (0.5 counts as a success); d-2: none of one.
    assert found.accuracy == pytest.approx((3 / 4 + 0) / 2)
    assert found.accuracy_micro == pytest.approx(3 / 5)
    assert found.accuracy_se == pytest.approx(np.sqrt(0.75 * 0.25 / 4 + 0) / 2)
    assert found.majority == pytest.approx((3 / 4 + 1) / 2)
    assert found.success == pytest.approx(3 / 5)
    assert found.n == 5


def test_what_is_not_a_number_is_null_in_json() -> None:
    found = score(np.array([0.5, 0.6]), np.array([True, True]), np.array(["d-1", "d-1"]))
    assert np.isnan(found.auroc)
    assert found.as_dict()["auroc"] is None
    assert json.loads(json.dumps(found.as_dict(), allow_nan=False))["n"] == 2


def test_no_samples() -> None:
    with pytest.raises(InputError, match="no samples to score"):
        score(np.zeros(0), np.zeros(0, bool), np.zeros(0, str))
