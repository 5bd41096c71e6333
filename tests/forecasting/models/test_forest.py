"""Forests as arrays answer as scikit-learn's do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from sklearn.ensemble import (
    ExtraTreesClassifier,
    ExtraTreesRegressor,
    RandomForestClassifier,
    RandomForestRegressor,
)

from graspcast.forecasting.models.forest import Forest, flatten

KINDS = [
    ExtraTreesClassifier,
    ExtraTreesRegressor,
    RandomForestClassifier,
    RandomForestRegressor,
]


def table(seed: int, n: int = 80) -> np.ndarray:
    """Columns of every sort: smooth, whole numbers, halves, neighbours in single precision."""
    rng = np.random.default_rng(seed)
    near = np.float32(1 / 3) + rng.integers(0, 4, n) * np.spacing(np.float32(1 / 3))
    return np.column_stack(
        [
            rng.normal(size=n),
            rng.integers(0, 4, n),
            rng.integers(0, 6, n) / 2,
            near,
            rng.integers(0, 8, n) + 2.0**24,
        ]
    ).astype(np.float64)


def grown(kind: Any, seed: int, **options: Any) -> tuple[Any, np.ndarray]:
    rows = table(seed)
    answer = rows[:, 0] + rows[:, 1] * rows[:, 2] + np.random.default_rng(seed).normal(size=80) > 2
    model = kind(7, random_state=seed, **options)
    return model.fit(rows.astype(np.float32), answer), rows


def asked(model: Any, rows: np.ndarray) -> np.ndarray:
    single = rows.astype(np.float32)
    if hasattr(model, "predict_proba"):
        return np.asarray(model.predict_proba(single)[:, 1])
    return np.asarray(model.predict(single))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@settings(max_examples=8)
@given(seed=st.integers(0, 1000), leaf=st.integers(1, 5))
def test_the_mean_is_scikit_learns(kind: Any, seed: int, leaf: int) -> None:
    model, rows = grown(kind, seed, min_samples_leaf=leaf)
    forest = flatten(model)
    assert forest.trees == 7
    for given_rows in (rows, table(seed + 1), np.round(rows * 2) / 2):
        assert_allclose(forest.mean(given_rows), asked(model, given_rows), rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_rows_on_a_threshold_go_where_scikit_learn_sends_them(kind: Any) -> None:
    model, rows = grown(kind, 3)
    forest = flatten(model)
    asked_rows = []
    for member in model.estimators_:
        tree = member.tree_
        for node in np.flatnonzero(tree.children_left >= 0):
            exact = np.float32(tree.threshold[node])
            for value in (np.nextafter(exact, -np.inf), exact, np.nextafter(exact, np.inf)):
                row = rows[node % len(rows)].copy()
                row[tree.feature[node]] = value
                asked_rows.append(row)
    on_edges = np.array(asked_rows)
    assert_same_leaves(model, forest, on_edges)


def assert_same_leaves(model: Any, forest: Forest, rows: np.ndarray) -> None:
    theirs = model.apply(rows.astype(np.float32))
    ours = forest.leaves(rows)
    for tree, member in enumerate(model.estimators_):
        numbered = np.cumsum(member.tree_.children_left < 0) - 1
        assert_array_equal(ours[:, tree], numbered[theirs[:, tree]])


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("seed", range(3))
def test_leaves_are_scikit_learns(kind: Any, seed: int) -> None:
    model, rows = grown(kind, seed)
    forest = flatten(model)
    assert_same_leaves(model, forest, rows)
    assert_same_leaves(model, forest, table(seed + 50))
    counts = forest.leaves(rows).max(axis=0) + 1
    assert counts.tolist() == [member.get_n_leaves() for member in model.estimators_]


def test_several_outputs_have_the_same_leaves_and_the_first_answer() -> None:
    rows = table(0)
    targets = np.random.default_rng(0).normal(size=(80, 6))
    model = ExtraTreesRegressor(5, random_state=0).fit(rows.astype(np.float32), targets)
    forest = flatten(model)
    assert_same_leaves(model, forest, rows)
    first = model.predict(rows.astype(np.float32))[:, 0]
    assert_allclose(forest.mean(rows), first, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_arrays_there_and_back(kind: Any) -> None:
    model, rows = grown(kind, 1)
    forest = flatten(model)
    arrays = forest.to_arrays("some")
    again = Forest.from_arrays(arrays | {"other/roots": np.zeros(2)}, "some")
    assert all(name.startswith("some/") for name in arrays)
    for mine, theirs in zip(forest.arrays(), again.arrays(), strict=True):
        assert mine.dtype == theirs.dtype
        assert_array_equal(mine, theirs)
    assert_array_equal(again.mean(rows), forest.mean(rows))


def test_a_row_is_answered_alike_alone_and_among_others() -> None:
    model, rows = grown(ExtraTreesClassifier, 2)
    forest = flatten(model)
    together = forest.mean(rows)
    assert_array_equal(together, np.concatenate([forest.mean(row[None]) for row in rows]))
    order = np.random.default_rng(0).permutation(len(rows))
    assert_array_equal(forest.mean(rows[order]), together[order])
    assert forest.mean(rows[:0]).shape == (0,)
