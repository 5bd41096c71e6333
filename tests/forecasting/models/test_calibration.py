"""Calibration: distortions are undone, and nothing is learned from too little."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from graspcast.forecasting.models.calibration import expit, fit_calibration, logit


def test_logit_and_expit_are_inverse_and_finite_at_the_ends() -> None:
    p = np.linspace(0.001, 0.999, 99)
    assert_allclose(expit(logit(p)), p, rtol=1e-12)
    assert_allclose(logit(np.array([0.0, 1.0])), [-np.log(999), np.log(999)])


def test_calibration_undoes_a_known_distortion() -> None:
    rng = np.random.default_rng(0)
    true = 1 / (1 + np.exp(-rng.normal(scale=1.5, size=20_000)))
    outcome = (rng.random(20_000) < true).astype(float)
    outcome[::10] = np.nan
    for slope, shift in ((2.0, 1.0), (0.5, -0.7), (1.0, 0.0)):
        forecast = 1 / (1 + np.exp(-(slope * logit(true) + shift)))
        forecast[1::10] = np.nan
        found = fit_calibration(forecast, outcome)
        assert_allclose(found, [1 / slope, -shift / slope], atol=0.08)


def test_calibration_leaves_alone_what_it_cannot_learn() -> None:
    rng = np.random.default_rng(0)
    forecast = rng.uniform(0.1, 0.9, 2000)
    against = (rng.random(2000) > forecast).astype(float)
    for given_, outcome in (
        (forecast, against),
        (forecast, np.ones(2000)),
        (forecast[:19], against[:19]),
        (np.full(2000, np.nan), against),
    ):
        assert_array_equal(fit_calibration(given_, outcome), [1, 0])
