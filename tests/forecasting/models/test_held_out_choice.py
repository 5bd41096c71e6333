"""The correction of highest forecasts."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.forecasting.models.held_out_choice import choice_from, choose_held_out

RNG = np.random.default_rng(0)
TRUE = np.full((8, 4000), 0.6)
OUTCOME = (RNG.random(TRUE.shape) < TRUE).astype(float)
NOISY = np.clip(TRUE + RNG.normal(scale=0.15, size=TRUE.shape), 0.01, 0.99)


def test_of_equal_grasps_the_highest_forecast_is_too_high_and_is_corrected() -> None:
    found = choose_held_out(NOISY, OUTCOME)
    assert NOISY.max(axis=0).mean() > 0.75  # what one would say without a correction
    assert found.probability.mean() == pytest.approx(found.success.mean(), abs=1e-3)
    assert abs(found.probability.mean() - 0.6) < 0.03


def test_one_grasp_is_not_corrected() -> None:
    found = choose_held_out(NOISY[:1], OUTCOME[:1])
    assert_array_equal(found.probability, NOISY[0])
    assert found.choice is None


def test_what_was_not_tried_or_has_no_forecast_is_not_chosen() -> None:
    probability = np.array([[0.9, 0.2, np.nan], [0.4, np.nan, 0.8], [0.5, 0.1, 0.7]])
    outcome = np.array([[np.nan, 1.0, 1.0], [0.0, 1.0, np.nan], [1.0, np.nan, np.nan]])
    found = choose_held_out(probability, outcome)
    assert_array_equal(found.rows, [0, 1])
    assert_array_equal(found.success, [True, True])
    assert_array_equal(found.probability, [0.5, 0.2])  # too few to correct by


def test_nothing_is_chosen_where_nothing_was_tried() -> None:
    found = choose_held_out(NOISY, np.full_like(NOISY, np.nan))
    assert not len(found.rows)
    assert found.choice is None


@pytest.mark.parametrize("wrong", [np.ones(3), np.array([1, 0]), np.array([np.nan, 0.0])])
def test_what_is_no_correction_is_refused(wrong: np.ndarray) -> None:
    assert choice_from({}, "choice") is None
    assert_array_equal(choice_from({"choice": np.array([0.9, -0.1])}, "choice"), [0.9, -0.1])
    with pytest.raises(ValueError, match="not a slope"):
        choice_from({"choice": wrong}, "choice")
