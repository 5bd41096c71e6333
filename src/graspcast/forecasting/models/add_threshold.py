"""The baseline: a threshold on the mean ADD between the principal and its supporters.

One threshold for each principal, object and gripper, as Section V-B of the paper has it; below it,
the grasp is predicted to succeed.

References
----------
G. Shi et al., *Fast Uncertainty Quantification for Deep Object Pose Estimation*, ICRA 2021.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError

__all__ = [
    "Thresholds",
    "fit_threshold",
    "fit_thresholds",
    "predict_below",
]


def fit_threshold(disagreement: Float[ndarray, " n"], success: Bool[ndarray, " n"]) -> float:
    """Return the threshold with the best accuracy on these samples.

    Candidates are all values but the smallest, and infinity; a sample strictly below the threshold
    is predicted to succeed; of equally accurate candidates the smallest is taken. The published
    table follows this rule; other ways to break ties differ from it by up to half a point.

    Raises
    ------
    InputError
        If there are no samples.
    """
    if len(disagreement) == 0:
        raise InputError("a threshold cannot be fitted to no samples")
    order = np.argsort(disagreement, kind="stable")
    value, succeeded = disagreement[order], success[order]
    candidates = np.append(value[1:], np.inf)
    below = np.searchsorted(value, candidates, side="left")
    successes_below = np.concatenate([[0], np.cumsum(succeeded)])[below]
    failures_above = (len(value) - below) - (succeeded.sum() - successes_below)
    return float(candidates[np.argmax(successes_below + failures_above)])


def fit_thresholds(
    disagreement: Float[ndarray, " n"], success: Bool[ndarray, " n"], objects: ndarray
) -> dict[str, float]:
    """Fit one threshold for each object's name."""
    return {
        str(name): fit_threshold(disagreement[objects == name], success[objects == name])
        for name in np.unique(objects)
    }


def predict_below(
    disagreement: Float[ndarray, " n"], thresholds: dict[str, float], objects: ndarray
) -> Bool[ndarray, " n"]:
    """Predict success where a sample lies below its object's threshold.

    Raises
    ------
    KeyError
        For an object without a threshold.
    """
    return disagreement < np.array([thresholds[str(name)] for name in objects])


@dataclass(frozen=True, eq=False)
class Thresholds:
    """Thresholds on one feature, the mean ADD in metres: one for each object, and one for all.

    The probability is the success rate of the training samples on the same side of the threshold,
    with one success and one failure added to each side (Laplace).

    Attributes
    ----------
    threshold
        Metres, (k + 1,); the last is fitted to all objects together, for unseen ones.
    rate_below, rate_above
        Success rates, (k + 1,).
    """

    threshold: Float[ndarray, " k"]
    rate_below: Float[ndarray, " k"]
    rate_above: Float[ndarray, " k"]

    @classmethod
    def fit(
        cls, features: Float[ndarray, "n d"], success: Bool[ndarray, " n"], objects: ndarray
    ) -> Thresholds:
        """Fit the threshold of each object number from 0 to the largest, and of all together."""
        value = features[:, 0]
        groups = [objects == k for k in range(int(objects.max()) + 1)]
        groups.append(np.full(len(value), True))
        rows = []
        for mine in groups:
            threshold = fit_threshold(value[mine], success[mine])
            below = value < threshold
            sides = (mine & below, mine & ~below)
            rows.append([threshold, *((success[s].sum() + 1) / (s.sum() + 2) for s in sides)])
        return cls(*np.array(rows, dtype=np.float64).T)

    def probability(
        self, features: Float[ndarray, "n d"], objects: ndarray
    ) -> Float[ndarray, " n"]:
        """Forecast the probability of success of each row."""
        below = features[:, 0] < self.threshold[objects]
        return np.where(below, self.rate_below[objects], self.rate_above[objects])

    def to_arrays(self) -> dict[str, ndarray]:
        """Return everything learned as named arrays."""
        return dict(self.__dict__)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, ndarray]) -> Thresholds:
        """Restore what :meth:`to_arrays` returned."""
        found = [arrays[name] for name in ("threshold", "rate_below", "rate_above")]
        if any(a.dtype != np.float64 or a.shape != (found[0].size,) for a in found):
            raise ValueError("thresholds and rates are not lists of numbers of one length")
        return cls(*found)
