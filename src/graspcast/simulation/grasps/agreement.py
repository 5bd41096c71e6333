"""Agreement of simulated outcomes with observed ones: accuracy and Cohen's kappa."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from graspcast.errors import InputError

__all__ = ["Agreement", "agreement"]


@dataclass(frozen=True)
class Agreement:
    """Agreement of two binary outcomes of the same trials.

    Attributes
    ----------
    n
        Number of trials.
    accuracy
        Share of trials with the same outcome.
    kappa
        Cohen's kappa; 0 if both sides have the same single outcome.
    majority
        Accuracy of always predicting the more frequent observed outcome.
    given_rate, simulated_rate
        Observed and simulated success rate.
    standard_error
        Standard error of ``accuracy`` for independent trials. Images are video frames, so the true
        one is larger.
    """

    n: int
    accuracy: float
    kappa: float
    majority: float
    given_rate: float
    simulated_rate: float
    standard_error: float


def agreement(
    simulated: Bool[ndarray, " n"],
    given: Bool[ndarray, " n"],
    weights: Float[ndarray, " n"] | None = None,
) -> Agreement:
    """Compare simulated with observed outcomes, weighted by ``weights`` if given.

    Raises
    ------
    InputError
        If there are no trials.
    """
    if not len(given):
        raise InputError("there are no trials whose outcomes could be compared")
    w = np.ones(len(given)) if weights is None else np.asarray(weights, dtype=np.float64)
    w = w / w.sum()
    same = float(w @ (simulated == given))
    p, q = float(w @ simulated), float(w @ given)
    chance = p * q + (1 - p) * (1 - q)
    return Agreement(
        n=len(given),
        accuracy=same,
        kappa=0.0 if chance > 1 - 1e-12 else (same - chance) / (1 - chance),
        majority=max(q, 1 - q),
        given_rate=q,
        simulated_rate=p,
        standard_error=float(np.sqrt(max(same * (1 - same), 0.0) * (w @ w))),
    )
