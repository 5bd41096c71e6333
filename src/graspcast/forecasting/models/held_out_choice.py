"""The grasp with the highest held-out forecast, and by how much choosing it is too optimistic.

Of several forecasts the highest tends to be one whose error is upward, so grasps that are chosen by
it succeed less often than it says. How much less is learned from out-of-fold predictions, by
logistic regression on the log-odds of the highest.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from graspcast.forecasting.models.calibration import (
    IDENTITY,
    calibrated,
    fit_calibration,
    fit_shift,
)

__all__ = ["HeldOutChoice", "choice_from", "choose_held_out"]


class HeldOutChoice(NamedTuple):
    """What was chosen among held-out forecasts.

    Attributes
    ----------
    rows
        Numbers of the instances with a forecast and an outcome of some grasp, ascending, (m,).
    probability
        Of the grasp with the highest forecast, corrected where there are several, (m,).
    success
        Its outcome, (m,).
    choice
        Slope and intercept on the log-odds of the correction; None where nothing is chosen.
    """

    rows: Int[ndarray, " m"]
    probability: Float[ndarray, " m"]
    success: Bool[ndarray, " m"]
    choice: Float[ndarray, "2"] | None


def choose_held_out(
    probability: Float[ndarray, "s n"], outcome: Float[ndarray, "s n"]
) -> HeldOutChoice:
    """Choose the grasp with the highest held-out forecast, among those that were tried.

    Parameters
    ----------
    probability
        Calibrated forecasts of each grasp, NaN where there is none.
    outcome
        1, 0, or NaN where a grasp was not tried.
    """
    known = ~np.isnan(probability) & ~np.isnan(outcome)
    rows = np.flatnonzero(known.any(axis=0))
    best = np.where(known, probability, -1.0)[:, rows].argmax(axis=0)
    highest, held = probability[best, rows], outcome[best, rows]
    several = known[:, rows].sum(axis=0) > 1
    choice = None
    if several.any():
        given = highest[several], held[several]
        choice = fit_calibration(*given)
        if np.array_equal(choice, IDENTITY):  # among these, higher ones are not the better ones
            choice = fit_shift(*given)
        highest = np.where(several, calibrated(highest, choice), highest)
    return HeldOutChoice(rows, highest, held == 1, choice)


def choice_from(arrays: Mapping[str, ndarray], name: str) -> Float[ndarray, "2"] | None:
    """Restore a correction from the arrays of a model, None if there is none of this name.

    Raises
    ------
    ValueError
        If it is no slope and intercept.
    """
    choice = arrays.get(name)
    if choice is None:
        return None
    if choice.shape != (2,) or choice.dtype != np.float64 or not np.isfinite(choice).all():
        raise ValueError("the correction of a choice is not a slope and an intercept")
    return choice
