"""Calibration of probabilities by logistic regression on their log-odds (Platt scaling).

References
----------
J. Platt, *Probabilistic Outputs for Support Vector Machines*, Advances in Large Margin Classifiers,
1999.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

__all__ = ["IDENTITY", "calibrated", "expit", "fit_calibration", "fit_shift", "logit"]


IDENTITY = np.array([1.0, 0.0])
"""Slope and intercept that change nothing."""


def logit(p: ndarray) -> ndarray:
    """Return log-odds; probabilities are clipped to [0.001, 0.999]."""
    bounded = np.minimum(np.maximum(p, 1e-3), 1 - 1e-3)
    return np.asarray(np.log(bounded / (1 - bounded)))


def expit(x: ndarray) -> ndarray:
    """Return the probabilities of log-odds."""
    return np.asarray(1 / (1 + np.exp(-x)))


def calibrated(raw: ndarray, calibration: Float[ndarray, "2"]) -> ndarray:
    """Return the calibrated probabilities of raw ones, by slope and intercept on the log-odds."""
    slope, intercept = calibration
    return expit(slope * logit(raw) + intercept)


def fit_calibration(forecast: ndarray, outcome: ndarray) -> Float[ndarray, "2"]:
    """Fit slope and intercept on the log-odds; (1, 0) if outcomes are too few or all equal."""
    from sklearn.linear_model import LogisticRegression

    has = ~np.isnan(forecast) & ~np.isnan(outcome)
    if has.sum() < 20 or len(np.unique(outcome[has])) < 2:
        return np.array([1.0, 0.0])
    model = LogisticRegression(C=1.0).fit(logit(forecast[has])[:, None], outcome[has])
    slope = float(model.coef_[0, 0])
    # A negative slope would invert forecasts that carry no information about new scenes.
    return np.array([slope, float(model.intercept_[0])]) if slope > 0 else np.array([1.0, 0.0])


def fit_shift(forecast: ndarray, outcome: ndarray) -> Float[ndarray, "2"]:
    """Fit the intercept alone, so that the mean forecast is the success rate; the slope is 1.

    It is 0 where outcomes are too few or all equal.
    """
    from scipy.optimize import brentq

    if len(forecast) < 20 or len(np.unique(outcome)) < 2:
        return np.array([1.0, 0.0])
    odds, rate = logit(forecast), float(np.mean(outcome))
    shift = brentq(lambda b: float(expit(odds + b).mean()) - rate, -20.0, 20.0)
    return np.array([1.0, float(shift)])
