"""Novelty detection: whether the estimators' disagreement is out of distribution.

The score of an instance is the Mahalanobis distance of its disagreement from those in training. The
disagreement holds each supporter's pose in the principal's ray frame (independent of the object);
large differences enter by their logarithm. The p-value is the share of out-of-fold training scores
that are at least as large (inductive conformal anomaly detection). For an instance of a scene like
those in training, P(p-value <= a) <= a, whatever the distribution of the scores.

References
----------
R. Laxhammar and G. Falkman, *Conformal prediction for distribution-independent anomaly detection in
streaming vessel data*, StreamKDD 2010.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import scene_groups
from graspcast.forecasting.splits import fold_numbers
from graspcast.pose.ray_frame import compressed, relative

__all__ = ["Novelty"]


@dataclass(frozen=True, eq=False)
class Novelty:
    """A conformal novelty detector for the estimators' disagreement.

    Attributes
    ----------
    centre
        Mean disagreement in training, (6 (K - 1),).
    precision
        Inverse covariance (Ledoit-Wolf), (6 (K - 1), 6 (K - 1)).
    scores
        Out-of-fold scores of the training instances, ascending, (m,).
    """

    centre: Float[ndarray, " d"]
    precision: Float[ndarray, "d d"]
    scores: Float[ndarray, " m"]

    @classmethod
    def fit(cls, estimates: Estimates, principal: str, *, folds: int = 4) -> Novelty:
        """Fit to the training instances; their scenes are assigned to ``folds`` in turn."""
        rows = disagreement(estimates, principal, estimates.supporters(principal))
        fold_of = fold_numbers(scene_groups(estimates.instances), folds)
        scores = np.empty(len(rows))
        for fold in range(fold_of.max() + 1):
            test = fold_of == fold
            train = test if test.all() else ~test
            scores[test] = _distance(rows[test], *_shape(rows[train]))
        return cls(*_shape(rows), np.sort(scores))

    def p_value(
        self, estimates: Estimates, principal: str, supporters: Sequence[str]
    ) -> Float[ndarray, " n"]:
        """Compute the conformal p-value of each instance's disagreement; small means novel."""
        rows = disagreement(estimates, principal, supporters)
        score = _distance(rows, self.centre, self.precision)
        at_least = len(self.scores) - np.searchsorted(self.scores, score, side="left")
        return (at_least + 1) / (len(self.scores) + 1)

    def to_arrays(self) -> dict[str, ndarray]:
        """Return everything as named arrays."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Novelty:
        """Restore what :meth:`to_arrays` returned."""
        found = cls(*(arrays[f.name] for f in fields(cls)))
        size = found.centre.size
        shapes = (found.centre.shape, found.precision.shape, found.scores.shape)
        if shapes != ((size,), (size, size), (found.scores.size,)):
            raise ValueError(f"the novelty detector has arrays of shapes {shapes}")
        if any(a.dtype != np.float64 or not np.isfinite(a).all() for a in arrays.values()):
            raise ValueError("the novelty detector has arrays of other than finite numbers")
        return found


def disagreement(
    estimates: Estimates, principal: str, supporters: Sequence[str]
) -> Float[ndarray, "n d"]:
    """Return each supporter's pose in the principal's ray frame, large values compressed."""
    pose = estimates.of(principal)
    seen = [compressed(relative(pose, estimates.of(name))) for name in supporters]
    return np.concatenate(seen, axis=1)


def _shape(rows: Float[ndarray, "n d"]) -> tuple[Float[ndarray, " d"], Float[ndarray, "d d"]]:
    from sklearn.covariance import LedoitWolf

    model = LedoitWolf().fit(rows)
    return model.location_, model.precision_


def _distance(
    rows: Float[ndarray, "n d"], centre: Float[ndarray, " d"], precision: Float[ndarray, "d d"]
) -> Float[ndarray, " n"]:
    away = rows - centre
    return np.asarray(np.einsum("ni,ij,nj->n", away, precision, away))
