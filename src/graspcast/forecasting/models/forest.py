"""Decision forests as flat arrays, saved without pickle and evaluated by compiled code.

A forest is grown by scikit-learn and then only read. Nodes are stored depth first, so the left
child of a node is the next one. Files do not depend on the version of scikit-learn, and a forecast
of one row takes microseconds instead of milliseconds.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, no_type_check

import numpy as np
from jaxtyping import Float, Float32, Int
from numpy import ndarray

from graspcast.io.cached import cached_property
from graspcast.io.compiling import cached_njit
from graspcast.pose.parallel import over_rows

__all__ = ["WALK_NS", "Forest", "flatten", "grow_forest", "walk"]

WALK_NS = 60.0
"""About how many nanoseconds a row takes through a tree."""


@dataclass(frozen=True, eq=False)
class Forest:
    """A forest of binary decision trees.

    Attributes
    ----------
    feature
        Column that a node tests, -1 at a leaf, (nodes,).
    threshold
        A row goes left if its value is at most this, (nodes,).
    right
        Number of the right child; at a leaf the leaf's number in its tree, (nodes,).
    value
        Prediction of a leaf, (nodes,).
    roots
        First node of each tree, and the number of nodes, (trees + 1,).
    """

    feature: Int[ndarray, " nodes"]
    threshold: Float32[ndarray, " nodes"]
    right: Int[ndarray, " nodes"]
    value: Float32[ndarray, " nodes"]
    roots: Int[ndarray, " trees_and_1"]

    @property
    def trees(self) -> int:
        """Number of trees."""
        return len(self.roots) - 1

    def mean(self, rows: Float[ndarray, "n d"]) -> Float[ndarray, " n"]:
        """Predict each row: the mean of the trees' predictions."""
        self.check_rows(rows)
        return self._over(rows, _mean, np.empty(len(rows)))

    def leaves(self, rows: Float[ndarray, "n d"]) -> Int[ndarray, "n trees"]:
        """Return the number, within its tree, of the leaf that each row reaches."""
        self.check_rows(rows)
        return self._over(rows, _leaves, np.empty((len(rows), self.trees), np.int32))

    def _over(self, rows: ndarray, kernel: Any, out: ndarray) -> ndarray:
        given = np.ascontiguousarray(rows, np.float32)
        over_rows(kernel, len(rows), WALK_NS * self.trees, given, *self.arrays(), out)
        return out

    def arrays(self) -> tuple[ndarray, ...]:
        """Return its arrays, in the order of the attributes."""
        return self.feature, self.threshold, self.right, self.value, self.roots

    def to_arrays(self, prefix: str) -> dict[str, ndarray]:
        """Return its arrays by name."""
        return {f"{prefix}/{f.name}": getattr(self, f.name) for f in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray], prefix: str) -> Forest:
        """Restore what :meth:`to_arrays` returned.

        Raises
        ------
        ValueError
            If the arrays are no forest: compiled code would loop for ever, or read elsewhere.
        """
        out = cls(*(arrays[f"{prefix}/{f.name}"] for f in fields(cls)))
        out._check()
        return out

    def _check(self) -> None:
        kinds = {"feature": "i", "threshold": "f", "right": "i", "value": "f", "roots": "i"}
        for name, kind in kinds.items():
            array = getattr(self, name)
            if array.ndim != 1 or array.dtype.kind != kind:
                raise ValueError(f"{name} of a forest is not a list of numbers of its kind")
        nodes, roots = len(self.feature), self.roots
        sizes = {len(self.threshold), len(self.right), len(self.value)}
        if sizes != {nodes} or len(roots) < 2 or roots[0] != 0 or roots[-1] != nodes:
            raise ValueError("the arrays of a forest have different lengths")
        if (np.diff(roots) < 1).any() or (self.feature < -1).any():
            raise ValueError("a tree of a forest is empty, or tests a column that is none")
        node = np.arange(nodes)
        last = np.repeat(roots[1:], np.diff(roots))
        leaf = self.feature < 0
        # Both children come after their parent, so every path ends; and within its tree.
        astray = ~leaf & ((self.right <= node + 1) | (self.right >= last))
        number = np.cumsum(leaf) - 1
        before = np.repeat(number[roots[:-1]] - leaf[roots[:-1]] + 1, np.diff(roots))
        if (
            astray.any()
            or (leaf & (self.right != number - before)).any()
            or not leaf[last - 1].all()
        ):
            raise ValueError("a node of a forest leads astray")
        if not (np.isfinite(self.threshold).all() and np.isfinite(self.value).all()):
            raise ValueError("a forest holds numbers that are not finite")

    @cached_property
    def columns(self) -> int:
        """Number of columns that a row needs at least."""
        return int(self.feature.max(initial=-1)) + 1

    def check_rows(self, rows: ndarray) -> None:
        """Raise a ValueError for rows with fewer columns than the forest tests."""
        if rows.shape[1] < self.columns:
            raise ValueError(f"a forest needs {self.columns} columns, not {rows.shape[1]}")


def grow_forest(model: Any, rows: Float[ndarray, "n d"], outcome: ndarray) -> Forest:
    """Grow a forest of scikit-learn, and return its trees.

    scikit-learn sets the filters of warnings in each of its threads. Before Python 3.14 these are
    the whole process's, so that threads empty each other's, which scikit-learn then warns about,
    and leave others than there were. Here they are put back, and that warning is not shown.

    Parameters
    ----------
    model
        A forest that is not fitted.
    rows, outcome
        What it is fitted to.
    """
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("ignore")
        model.fit(rows.astype(np.float32), outcome)
    return flatten(model)


def flatten(model: Any) -> Forest:
    """Convert a scikit-learn forest (classifier of two classes, or regressor) to arrays.

    A classifier predicts the share of its second class, a regressor of several outputs the first.
    """
    feature, threshold, right, value, roots = [], [], [], [], [0]
    for member in model.estimators_:
        tree = member.tree_
        leaf = tree.children_left < 0
        inner = ~leaf
        assert (tree.children_left[inner] == np.flatnonzero(inner) + 1).all(), "not depth first"
        offset = roots[-1]
        # Rounded down, so that comparisons in single precision equal those in double precision.
        rounded = tree.threshold.astype(np.float32)
        rounded = np.where(
            rounded > tree.threshold, np.nextafter(rounded, np.float32(-np.inf)), rounded
        )
        answers = tree.value[:, 0]
        if answers.shape[1] == 2:
            answers = answers[:, 1:] / answers.sum(axis=1, keepdims=True)
        feature.append(np.where(leaf, -1, tree.feature).astype(np.int16))
        threshold.append(np.where(leaf, np.float32(0), rounded))
        right.append(np.where(leaf, np.cumsum(leaf) - 1, tree.children_right + offset))
        value.append(np.where(leaf, answers[:, 0], 0).astype(np.float32))
        roots.append(offset + tree.node_count)
    return Forest(
        np.concatenate(feature),
        np.concatenate(threshold).astype(np.float32),
        np.concatenate(right).astype(np.int32),
        np.concatenate(value),
        np.array(roots, dtype=np.int32),
    )


@no_type_check
@cached_njit(inline="always")
def walk(row, node, feature, threshold, right):
    """Return the leaf that a row reaches from a tree's first node."""
    column = feature[node]
    while column >= 0:
        # Arithmetic instead of a branch, which the processor would often mispredict.
        left = row[column] <= threshold[node]
        node = right[node] + (node + 1 - right[node]) * left
        column = feature[node]
    return node


@no_type_check
@cached_njit(inline="always")
def walk_together(row, nodes, feature, threshold, right):
    """Replace each of some nodes, of different trees, by the leaf that a row reaches from it.

    All of them go down level by level, so that the processor waits for many nodes at once that are
    not in its cache, instead of one after the other.
    """
    moved = True
    while moved:
        moved = False
        for k in range(len(nodes)):
            node = nodes[k]
            column = feature[node]
            if column >= 0:
                left = row[column] <= threshold[node]
                nodes[k] = right[node] + (node + 1 - right[node]) * left
                moved = True


@no_type_check
@cached_njit(nogil=True)
def _mean(start, stop, rows, feature, threshold, right, value, roots, out):
    trees = len(roots) - 1
    nodes = np.empty(trees, np.int64)
    for i in range(start, stop):
        # One by one: the assignment of a slice takes numba two seconds to compile.
        for k in range(trees):
            nodes[k] = roots[k]
        walk_together(rows[i], nodes, feature, threshold, right)
        total = 0.0
        for node in nodes:
            total += value[node]
        out[i] = total / trees


@no_type_check
@cached_njit(nogil=True)
def _leaves(start, stop, rows, feature, threshold, right, value, roots, out):
    for i in range(start, stop):
        for tree in range(len(roots) - 1):
            out[i, tree] = right[walk(rows[i], roots[tree], feature, threshold, right)]
