"""Forests as arrays answer as scikit-learn's do."""

from __future__ import annotations

import warnings
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

from graspcast.forecasting.models.forest import Forest, flatten, grow_forest

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


# --- Arrays that are no forest --------------------------------------------------------------------


def stump() -> dict[str, np.ndarray]:
    """Two trees: one of three nodes, one of five."""
    return {
        "f/feature": np.array([0, -1, -1, 1, 0, -1, -1, -1], np.int16),
        "f/threshold": np.zeros(8, np.float32),
        "f/right": np.array([2, 0, 1, 7, 6, 0, 1, 2], np.int32),
        "f/value": np.linspace(0, 1, 8, dtype=np.float32),
        "f/roots": np.array([0, 3, 8], np.int32),
    }


def test_a_whole_forest_is_read() -> None:
    forest = Forest.from_arrays(stump(), "f")
    assert (forest.trees, forest.columns) == (2, 2)
    assert forest.leaves(np.array([[1.0, -1.0], [-1.0, 1.0]])).tolist() == [[1, 1], [0, 2]]
    with pytest.raises(ValueError, match="needs 2 columns, not 1"):
        forest.mean(np.zeros((3, 1)))


@pytest.mark.parametrize(
    ("name", "place", "value"),
    [
        ("right", 0, 0),  # its own child: an endless loop
        ("right", 0, 1),
        ("right", 0, 3),  # a node of another tree
        ("right", 3, 10**6),  # beyond the end
        ("right", 3, -5),
        ("right", 1, 7),  # a leaf that is none
        ("feature", 2, 0),  # the last node has no child
        ("feature", 0, -2),
        ("threshold", 0, np.nan),
        ("value", 1, np.inf),
        ("roots", 1, 9),
        ("roots", 0, 1),
        ("roots", 2, 7),
    ],
)
def test_arrays_that_would_loop_or_read_elsewhere_are_refused(
    name: str, place: int, value: float
) -> None:
    arrays = stump()
    arrays[f"f/{name}"][place] = value
    with pytest.raises(ValueError, match="forest"):
        Forest.from_arrays(arrays, "f")


@pytest.mark.ill_typed
@pytest.mark.parametrize("name", ["feature", "threshold", "right", "value", "roots"])
def test_arrays_of_other_types_and_lengths_are_refused(name: str) -> None:
    whole = stump()[f"f/{name}"]
    for wrong in (whole[:-1], whole[None], whole.astype(str), whole[:0]):
        with pytest.raises(ValueError, match="forest"):
            Forest.from_arrays(stump() | {f"f/{name}": wrong}, "f")


class TurnsWarningsRound:
    """Leaves the filters of warnings as threads of scikit-learn may leave them."""

    def __init__(self, model: Any) -> None:
        self.model = model

    def fit(self, rows: np.ndarray, outcome: np.ndarray) -> None:
        warnings.resetwarnings()
        warnings.simplefilter("error")
        warnings.resetwarnings()
        warnings.warn("`delayed` should be used with `Parallel`", UserWarning, stacklevel=1)
        self.model.fit(rows, outcome)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.model, name)


def test_growing_leaves_the_filters_of_warnings_as_they_were() -> None:
    rng = np.random.default_rng(0)
    rows, outcome = rng.normal(size=(40, 3)), rng.random(40) < 0.5
    model = ExtraTreesClassifier(4, random_state=0)
    before = list(warnings.filters)
    forest = grow_forest(TurnsWarningsRound(model), rows, outcome)
    assert list(warnings.filters) == before
    expected = model.predict_proba(rows.astype(np.float32))[:, 1]
    np.testing.assert_allclose(forest.mean(rows), expected, atol=1e-6)
