"""The two-stage model: a distribution of the pose error, and success given the pose error.

Stage one, the **error model**, is a forest that is fitted on poses and ground truth of all objects
together. Given how the supporters disagree, it predicts the distribution of the true pose in the
principal's ray frame. Each leaf holds training instances, and those in the leaves that a new
instance reaches are draws from a nonparametric distribution (a quantile regression forest with a
6-D response). Stage two, **success given error**, is a forest that is fitted on outcomes or
simulated trials: from the pose error in the object's frame, the object and its grasp, to success,
whichever estimator made the error. The forecast is the mean of stage two over draws from stage one.

References
----------
N. Meinshausen, *Quantile Regression Forests*, Journal of Machine Learning Research, 2006.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.forecasting.models.forest import WALK_NS, Forest, grow_forest, walk, walk_together
from graspcast.io.compiling import cached_njit
from graspcast.pose.parallel import over_rows
from graspcast.pose.ray_frame import compressed
from graspcast.pose.transforms import rotation_vector

__all__ = ["ERROR_INPUTS", "ErrorModel", "SuccessGivenError", "expected_success"]

ERROR_INPUTS = 8
"""Inputs of the second stage that describe the pose error: see :class:`SuccessGivenError`."""


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Conditional distribution of the true pose in the estimate's ray frame, given features.

    Attributes
    ----------
    forest
        Assigns a row to a leaf of each tree.
    first
        Index in ``members`` of each leaf's first member, leaf by leaf, tree by tree.
    offset
        Number of the first leaf of each tree, (trees,).
    members
        Numbers of the training instances in each leaf.
    truth
        Each training instance's true pose in its estimate's ray frame (see
        :func:`graspcast.pose.ray_frame.relative`), (m, 6).
    """

    forest: Forest
    first: Int[ndarray, " leaves_and_1"]
    offset: Int[ndarray, " trees"]
    members: Int[ndarray, " entries"]
    truth: Float[ndarray, "m 6"]

    @classmethod
    def fit(
        cls, features: Float[ndarray, "m d"], truth: Float[ndarray, "m 6"], *, trees: int, seed: int
    ) -> ErrorModel:
        """Fit on instances whose true pose is known."""
        from sklearn.ensemble import ExtraTreesRegressor

        model = ExtraTreesRegressor(
            trees, min_samples_leaf=2, max_features=0.5, random_state=seed, n_jobs=-1
        )
        forest = grow_forest(model, features, compressed(truth))
        leaves = forest.leaves(features)
        counts = leaves.max(axis=0) + 1
        offset = np.cumsum(counts) - counts
        numbered = (leaves + offset).T.ravel()
        order = np.argsort(numbered, kind="stable")
        first = np.searchsorted(numbered[order], np.arange(counts.sum() + 1))
        return cls(
            forest,
            first.astype(np.int32),
            offset.astype(np.int32),
            (order % len(truth)).astype(np.int32),
            truth,
        )

    def draws(self, features: Float[ndarray, "n d"], count: int) -> Float[ndarray, "n count 6"]:
        """Draw true poses from the distribution; the draws are the same for equal rows."""
        leaves = self.forest.leaves(features) + self.offset
        trees = np.arange(count) % self.forest.trees
        start, stop = self.first[leaves[:, trees]], self.first[leaves[:, trees] + 1]
        place = start + (_places(count) * (stop - start)).astype(np.int64)
        return self.truth[self.members[place]]

    def to_arrays(self, prefix: str) -> dict[str, ndarray]:
        """Return everything learned as named arrays."""
        own = {name: getattr(self, name) for name in ("first", "offset", "members", "truth")}
        return {f"{prefix}/{k}": v for k, v in own.items()} | self.forest.to_arrays(f"{prefix}/f")

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray], prefix: str) -> ErrorModel:
        """Restore what :meth:`to_arrays` returned.

        Raises
        ------
        ValueError
            If the arrays are no error model.
        """
        names = ("first", "offset", "members", "truth")
        out = cls(
            Forest.from_arrays(arrays, f"{prefix}/f"), *(arrays[f"{prefix}/{k}"] for k in names)
        )
        out._check()
        return out

    def _check(self) -> None:
        leaf = (self.forest.feature < 0).astype(np.int64)
        counts = np.add.reduceat(leaf, self.forest.roots[:-1])
        whole = all(a.dtype.kind == "i" for a in (self.first, self.offset, self.members))
        if not whole or self.truth.ndim != 2 or self.truth.shape[1] != 6 or self.members.ndim != 1:
            raise ValueError("the arrays of an error model have wrong types or shapes")
        if not np.array_equal(self.offset, np.cumsum(counts) - counts):
            raise ValueError("the leaves of an error model are numbered wrongly")
        first, entries = self.first, len(self.members)
        ordered = first.shape == (counts.sum() + 1,) and (np.diff(first) > 0).all()
        if not ordered or first[0] != 0 or first[-1] != entries:
            raise ValueError("a leaf of an error model has no members")
        if ((self.members < 0) | (self.members >= len(self.truth))).any():
            raise ValueError("an error model has members that are no instances")
        if not np.isfinite(self.truth).all():
            raise ValueError("an error model holds numbers that are not finite")


@lru_cache(maxsize=16)
def _places(count: int) -> Float[ndarray, " count"]:
    """Return evenly spread numbers in [0, 1): multiples of the golden ratio (low discrepancy)."""
    return np.asarray((np.arange(1, count + 1) * 0.6180339887498949) % 1.0)


@dataclass(frozen=True, eq=False)
class SuccessGivenError:
    """Probability of success given the pose error, the object and the grasp.

    Attributes
    ----------
    forest
        Its inputs are the error's translation (m), rotation vector (rad), their lengths, and the
        target's code.
    codes
        Code of each target (:meth:`graspcast.forecasting.models.targets.Targets.codes`), (T, C).
    """

    forest: Forest
    codes: Float[ndarray, "t c"]

    @classmethod
    def fit(
        cls,
        obj_T_est: Float[ndarray, "m 4 4"],
        numbers: Int[ndarray, " m"],
        success: Bool[ndarray, " m"],
        *,
        codes: Float[ndarray, "t c"],
        trees: int,
        seed: int,
    ) -> SuccessGivenError:
        """Fit on trials whose pose error and outcome are known."""
        from sklearn.ensemble import ExtraTreesClassifier

        rows = np.concatenate([_error_inputs(obj_T_est), codes[numbers]], axis=1)
        model = ExtraTreesClassifier(
            trees, min_samples_leaf=1, max_features=0.7, random_state=seed, n_jobs=-1
        )
        return cls(grow_forest(model, rows, success), codes)

    def probability(
        self, obj_T_est: Float[ndarray, "n 4 4"], numbers: Int[ndarray, " n"]
    ) -> Float[ndarray, " n"]:
        """Forecast the probability of success of grasps guided by estimates with known errors."""
        return self.forest.mean(
            np.concatenate([_error_inputs(obj_T_est), self.codes[numbers]], axis=1)
        )


def _error_inputs(obj_T_est: Float[ndarray, "n 4 4"]) -> Float[ndarray, "n 8"]:
    shift, turn = obj_T_est[:, :3, 3], rotation_vector(obj_T_est[:, :3, :3])
    lengths = [np.linalg.norm(part, axis=1, keepdims=True) for part in (shift, turn)]
    return np.concatenate([shift, turn, *lengths], axis=1)


def expected_success(
    errors: ErrorModel,
    success_given_error: SuccessGivenError,
    features: Float[ndarray, "n d"],
    axes: Float[ndarray, "n 3 3"],
    distance: Float[ndarray, " n"],
    numbers: Int[ndarray, " n"],
    *,
    est_T_guide: Float[ndarray, "n 4 4"] | None = None,
    draws: int = 128,
    trees: int = 4,
) -> Float[ndarray, " n"]:
    """Compute the probability of success, averaged over draws of the pose error.

    Parameters
    ----------
    errors, success_given_error
        The two stages.
    features
        Inputs of the error model.
    axes
        :func:`graspcast.pose.ray_frame.obj_R_ray` of each estimate.
    distance
        Distance of each from the camera, metres.
    numbers
        The target of each in the second stage.
    est_T_guide
        The pose that guides the grasp, in the frame of the estimate around which true poses are
        drawn; None where that estimate guides.
    draws
        Pose errors drawn for each instance.
    trees
        Trees of the second stage that evaluate each draw; a different few for every draw, so that
        all trees take part.
    """
    errors.forest.check_rows(features)
    out = np.empty(len(features))
    guide = np.eye(4)[None] if est_T_guide is None else est_T_guide
    over_rows(
        _expected,
        len(features),
        WALK_NS * draws * (1 + trees),
        np.ascontiguousarray(features, np.float32),
        np.ascontiguousarray(axes, np.float64),
        np.ascontiguousarray(distance, np.float64),
        np.ascontiguousarray(guide, np.float64),
        est_T_guide is not None,
        numbers.astype(np.int64),
        _repeats(features, axes, distance, est_T_guide),
        *errors.forest.arrays(),
        errors.first,
        errors.offset,
        errors.members,
        errors.truth,
        *success_given_error.forest.arrays(),
        success_given_error.codes,
        _places(draws),
        min(trees, success_given_error.forest.trees),
        out,
    )
    return out


def _repeats(*columns: ndarray | None) -> Bool[ndarray, " n"]:
    """Find the rows of columns that are equal to the row before, (n,)."""
    given = [column for column in columns if column is not None]
    out = np.ones(len(given[0]), dtype=bool)
    out[:1] = False
    for column in given:
        if not out.any():
            break
        same = column[1:] == column[:-1]
        out[1:] &= same.reshape(len(same), -1).all(axis=1)
    return out


@no_type_check
@cached_njit()
def _exp(v, out):
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    a = np.sin(angle) / angle if angle > 1e-9 else 1.0
    b = (1 - np.cos(angle)) / (angle * angle) if angle > 1e-6 else 0.5
    x, y, z = v[0], v[1], v[2]
    out[0, 0], out[0, 1], out[0, 2] = 1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    out[1, 0], out[1, 1], out[1, 2] = b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x
    out[2, 0], out[2, 1], out[2, 2] = b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)


@no_type_check
@cached_njit()
def _log(R, out):
    """Rotation vector of a rotation matrix, by its quaternion, from the largest component."""
    q = np.empty(4)
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    squares = (1 + trace, 1 - trace + 2 * R[0, 0], 1 - trace + 2 * R[1, 1], 1 - trace + 2 * R[2, 2])
    top = 0
    for k in range(1, 4):
        top = k if squares[k] > squares[top] else top
    if top == 0:
        q[0] = squares[0]
        q[1], q[2], q[3] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    elif top == 1:
        q[1] = squares[1]
        q[0], q[2], q[3] = R[2, 1] - R[1, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]
    elif top == 2:
        q[2] = squares[2]
        q[0], q[1], q[3] = R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], R[1, 2] + R[2, 1]
    else:
        q[3] = squares[3]
        q[0], q[1], q[2] = R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1]
    length = np.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    sign = 1.0 if q[0] >= 0 else -1.0
    # 2 atan(|v| / w) / |v|; for a small rotation 2 / w.
    scale = 2 * np.arctan2(length, sign * q[0]) / length if length > 1e-12 else 0.0
    for k in range(3):
        out[k] = sign * scale * q[1 + k]


@no_type_check
@cached_njit()
def _carry(row, est_T_guide):
    """Replace the error of the estimate, six inputs, by that of the pose that guides."""
    turn, total, vector = np.empty((3, 3)), np.zeros((3, 3)), np.empty(3)
    for k in range(3):
        vector[k] = row[3 + k]
    _exp(vector, turn)
    for r in range(3):
        shift = 0.0
        for c in range(3):
            shift += turn[r, c] * est_T_guide[c, 3]
            for k in range(3):
                total[r, c] += turn[r, k] * est_T_guide[k, c]
        row[r] += shift
    _log(total, vector)
    for k in range(3):
        row[3 + k] = vector[k]


@no_type_check
@cached_njit(nogil=True)
def _expected(
    start, stop, rows, axes, distance, guide, guided, numbers, repeats,
    feature, threshold, right, value, roots, first, offset, members, truth,
    s_feature, s_threshold, s_right, s_value, s_roots, codes, places, trees_a_draw, out,
):  # fmt: skip
    trees, s_trees, draws = len(roots) - 1, len(s_roots) - 1, len(places)
    stride = max(1, s_trees // trees_a_draw)
    nodes = np.empty(draws, np.int64)
    inputs = np.empty((draws, 8 + codes.shape[1]), dtype=np.float32)
    turn = np.empty((3, 3))
    for i in range(start, stop):
        # Not as one assignment, which numba would compile for over a second.
        for draw in range(draws):
            for k in range(codes.shape[1]):
                inputs[draw, 8 + k] = codes[numbers[i], k]
        # The errors of a row that differs from the one before in its target alone are the same.
        if i == start or not repeats[i]:
            for draw in range(draws):
                nodes[draw] = roots[draw % trees]
            walk_together(rows[i], nodes, feature, threshold, right)
            for draw in range(draws):
                tree = draw % trees
                leaf = right[nodes[draw]] + offset[tree]
                size = first[leaf + 1] - first[leaf]
                drawn = truth[members[first[leaf] + int(places[draw] * size)]]
                # As in pose.ray_frame.error_along; the negated rotation vector, rotated from the
                # ray frame into the object's, is that of the pose error.
                _exp(drawn[3:], turn)
                A, row = axes[i], inputs[draw]
                for r in range(3):
                    back = 0.0
                    vector = 0.0
                    for c in range(3):
                        # (Dᵀ s)_c and (-ω)_c, rotated by A
                        shifted = (
                            turn[0, c] * drawn[0] + turn[1, c] * drawn[1] + turn[2, c] * drawn[2]
                        )
                        back += A[r, c] * shifted
                        vector -= A[r, c] * drawn[3 + c]
                    row[r] = -distance[i] * back
                    row[3 + r] = vector
                if guided:
                    _carry(row, guide[i])
                row[6] = np.sqrt(row[0] ** 2 + row[1] ** 2 + row[2] ** 2)
                row[7] = np.sqrt(row[3] ** 2 + row[4] ** 2 + row[5] ** 2)
        # Tree by tree, so that its nodes stay in the cache.
        total, count = 0.0, 0
        for tree in range(s_trees):
            for draw in range(tree % stride, draws, stride):
                node = walk(inputs[draw], s_roots[tree], s_feature, s_threshold, s_right)
                total += s_value[node]
                count += 1
        out[i] = total / count
