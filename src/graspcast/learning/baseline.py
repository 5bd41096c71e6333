"""The baseline: a threshold on the mean ADD between the principal and its supporters.

Shi et al., *Fast Uncertainty Quantification for Deep Object Pose Estimation* (ICRA 2021), as
Section V-B of the paper adapts it: one threshold for each (principal, object, gripper); below it,
the grasp is predicted to succeed.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError

__all__ = ["fit_threshold", "fit_thresholds", "predict_below"]


def fit_threshold(disagreement: Float[ndarray, "n"], success: Bool[ndarray, "n"]) -> float:
    """The threshold with the best accuracy on these samples.

    Candidates are the values themselves but the smallest, and infinity; a sample is predicted to
    succeed if it lies strictly below; of equally good candidates the smallest is taken. This is the
    rule behind the published table, which other ways to break ties miss by up to half a point.

    Raises:
        InputError: if there are no samples.
    """
    if len(disagreement) == 0:
        raise InputError("a threshold cannot be learned from no samples")
    order = np.argsort(disagreement, kind="stable")
    value, held = disagreement[order], success[order]
    candidates = np.append(value[1:], np.inf)
    below = np.searchsorted(value, candidates, side="left")
    held_below = np.concatenate([[0], np.cumsum(held)])[below]
    right = held_below + (len(held) - below) - (held.sum() - held_below)
    return float(candidates[np.argmax(right)])


def fit_thresholds(
    disagreement: Float[ndarray, "n"], success: Bool[ndarray, "n"], objects: ndarray
) -> dict[str, float]:
    """One threshold for each object's name."""
    return {
        str(name): fit_threshold(disagreement[objects == name], success[objects == name])
        for name in np.unique(objects)
    }


def predict_below(
    disagreement: Float[ndarray, "n"], thresholds: dict[str, float], objects: ndarray
) -> Bool[ndarray, "n"]:
    """Whether each sample lies below its object's threshold.

    Raises:
        KeyError: for an object without a threshold.
    """
    return disagreement < np.array([thresholds[str(name)] for name in objects])
