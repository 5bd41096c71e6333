"""Whether a disagreement is like those that training has seen: a conformal test.

The score of an instance is its Mahalanobis distance from the training instances, over what the
supporters say in the principal's ray frame (nothing of the object), large differences by their
logarithm. Its p-value is the share of calibration scores at least as large, those computed for
scenes that the distance had not seen (inductive conformal anomaly detection, Laxhammar and Falkman
2010). For an instance from a scene like the training's, P(p-value <= a) <= a, whatever the
distribution of the scores.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from graspcast.estimates.alignment import Estimates
from graspcast.estimates.instances import scene_groups
from graspcast.pose.ray_frame import compressed, relative

__all__ = ["Novelty"]


@dataclass(frozen=True, eq=False)
class Novelty:
    """What training's disagreements look like.

    Attributes
    ----------
    centre
        (6 (K - 1),).
    precision
        Inverse covariance, (6 (K - 1), 6 (K - 1)).
    scores
        Of held-out training instances, ascending, (m,).
    """

    centre: Float[ndarray, "d"]
    precision: Float[ndarray, "d d"]
    scores: Float[ndarray, "m"]

    @classmethod
    def fit(cls, estimates: Estimates, principal: str, *, folds: int = 4) -> Novelty:
        """Learn from the training instances; their scenes are dealt into ``folds`` in turn."""
        rows = disagreement(estimates, principal, estimates.supporters(principal))
        names, group = np.unique(scene_groups(estimates.instances), return_inverse=True)
        part = group % min(folds, len(names))
        scores = np.empty(len(rows))
        for fold in range(part.max() + 1):
            kept = part != fold if part.max() > 0 else part == fold
            scores[part == fold] = _distance(rows[part == fold], *_shape(rows[kept]))
        return cls(*_shape(rows), np.sort(scores))

    def p_value(
        self, estimates: Estimates, principal: str, supporters: Sequence[str]
    ) -> Float[ndarray, "n"]:
        """How unusual each instance's disagreement is: small is strange."""
        rows = disagreement(estimates, principal, supporters)
        score = _distance(rows, self.centre, self.precision)
        at_least = len(self.scores) - np.searchsorted(self.scores, score, side="left")
        return (at_least + 1) / (len(self.scores) + 1)

    def to_arrays(self) -> dict[str, ndarray]:
        """Named arrays."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Novelty:
        """The inverse of :meth:`to_arrays`."""
        return cls(*(arrays[f.name] for f in fields(cls)))


def disagreement(
    estimates: Estimates, principal: str, supporters: Sequence[str]
) -> Float[ndarray, "n d"]:
    """Each supporter in the principal's ray frame, small differences as they are."""
    pose = estimates.of(principal)
    seen = [compressed(relative(pose, estimates.of(name))) for name in supporters]
    return np.concatenate(seen, axis=1)


def _shape(rows: Float[ndarray, "n d"]) -> tuple[Float[ndarray, "d"], Float[ndarray, "d d"]]:
    from sklearn.covariance import LedoitWolf

    model = LedoitWolf().fit(rows)
    return model.location_, model.precision_


def _distance(
    rows: Float[ndarray, "n d"], centre: Float[ndarray, "d"], precision: Float[ndarray, "d d"]
) -> Float[ndarray, "n"]:
    away = rows - centre
    return np.asarray(np.einsum("ni,ij,nj->n", away, precision, away))
