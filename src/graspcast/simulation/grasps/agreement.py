"""How well simulated outcomes agree with given ones."""

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
        Trials.
    accuracy
        Share of them with the same outcome.
    kappa
        Cohen's kappa; 0 where either side has one outcome only.
    majority
        What always guessing the more frequent given outcome would reach.
    given_rate, simulated_rate
        Success rates.
    standard_error
        Of ``accuracy``, as if trials were independent. Frames are video, so the true one is larger.
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
    """Compare outcomes; with ``weights``, as if each trial stood for so many.

    Raises
    ------
    InputError
        For no trials at all.
    """
    if not len(given):
        raise InputError("there are no trials to compare outcomes of")
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
