"""Which calibration trials are attempted at a threshold, and which of these succeed.

A trial is one forecast with its outcome, or several in order: those after one look, after two, and
so on. At a threshold the first that reaches it is attempted, so the outcome of a trial may differ
from threshold to threshold. NaN is no forecast, and reaches none.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

__all__ = ["Forecasts", "Outcomes", "attempts_at", "first_to_reach", "largest", "of_looks"]

Forecasts = Float[ndarray, "n"] | Float[ndarray, "n s"]
"""One forecast for each of n trials, or several in order; NaN is none."""
Outcomes = Bool[ndarray, "n"] | Bool[ndarray, "n s"]
"""The outcomes of what would be attempted at each forecast."""


def attempts_at(
    threshold: float, probability: Forecasts, success: Outcomes
) -> tuple[Bool[ndarray, " n"], Bool[ndarray, " n"]]:
    """Return which trials are attempted at a threshold, and which attempts succeed."""
    reached: ndarray = of_looks(probability) >= threshold  # False where it is NaN
    attempted = np.asarray(reached.any(axis=1))
    first = reached.argmax(axis=1)
    return attempted, attempted & of_looks(success)[np.arange(len(first)), first]


def first_to_reach(probability: Float[ndarray, "n s"]) -> Bool[ndarray, "n s"]:
    """Say which forecasts are the first to reach some threshold: larger than all before them."""
    filled = np.where(np.isnan(probability), -np.inf, probability)
    before = np.maximum.accumulate(filled, axis=1)[:, :-1]
    none = np.full((len(probability), 1), -np.inf)
    return np.asarray(filled > np.concatenate([none, before], axis=1))


def largest(probability: Forecasts) -> Float[ndarray, " n"]:
    """Return the largest threshold at which each trial is attempted; 0 where there is none."""
    filled = np.where(np.isnan(probability), 0.0, probability)
    return np.asarray(of_looks(filled).max(axis=1))


def of_looks(values: ndarray) -> ndarray:
    """Return values of shape (n, looks), also those of one look, (n,)."""
    return values[:, None] if values.ndim == 1 else values
