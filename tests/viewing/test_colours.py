"""Colours of probabilities: in order of brightness, and grey where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.viewing.colours import ESTIMATORS, UNKNOWN, of_probability, probability_legend


def test_the_more_probable_is_brighter() -> None:
    bright = [np.dot(of_probability(p), (0.2126, 0.7152, 0.0722)) for p in np.linspace(0, 1, 21)]
    assert (np.diff(bright) > 0).all()


@pytest.mark.parametrize("probability", [None, np.nan, -0.1, 1.1])
def test_what_is_no_probability_is_grey(probability: float | None) -> None:
    assert of_probability(probability) == UNKNOWN


def test_the_legend_is_of_the_same_colours() -> None:
    assert dict(probability_legend())["grasp succeeds with probability 0.5"] == of_probability(0.5)
    assert len(set(ESTIMATORS)) == len(ESTIMATORS)
