"""Out-of-fold predictions: units, and arrays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from graspcast.forecasting.models.out_of_fold import OutOfFold

FOUND = OutOfFold(
    np.array([0.2, 0.9, 0.4]),
    np.array([False, True, True]),
    np.array(["lmo/2/7", "lmo/2/12", "ycbv/50/1"]),
)


def test_units_are_images_or_scenes() -> None:
    assert FOUND.units("image").tolist() == ["lmo/2/7", "lmo/2/12", "ycbv/50/1"]
    assert FOUND.units("scene").tolist() == ["lmo/2", "lmo/2", "ycbv/50"]


def test_arrays_restore_it() -> None:
    again = OutOfFold.from_arrays(FOUND.to_arrays() | {"other": np.zeros(1)})
    assert_array_equal(again.probability, FOUND.probability)
    assert_array_equal(again.success, FOUND.success)
    assert_array_equal(again.image, FOUND.image)


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("probability", np.array([0.1, 0.2])),
        ("success", np.array([0.0, 1.0, 1.0])),
        ("image", np.arange(3)),
    ],
)
def test_what_are_no_predictions_is_refused(name: str, value: np.ndarray) -> None:
    with pytest.raises(ValueError, match="the out-of-fold predictions"):
        OutOfFold.from_arrays(FOUND.to_arrays() | {f"out_of_fold/{name}": value})
