"""Settings of training."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.errors import InputError
from graspcast.forecasting.models.mlp.types import (
    MlpSettings,
)


@pytest.mark.parametrize(
    "change", [{"epochs": 0}, {"hidden": (0,)}, {"rate": -1.0}, {"beta1": 1.0}]
)
def test_settings_out_of_range_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(InputError):
        MlpSettings(**change)  # type: ignore[arg-type]


def test_the_learning_rate_falls_along_half_a_cosine() -> None:
    rates = MlpSettings(epochs=4, rate=1.0, final_rate=0.2).rates()
    half = np.sqrt(0.5)
    np.testing.assert_allclose(rates, [1.0, 0.6 + 0.4 * half, 0.6, 0.6 - 0.4 * half])
