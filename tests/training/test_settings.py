"""Settings of training are checked when they are made."""

from __future__ import annotations

from typing import Any

import pytest

from graspcast.errors import GraspcastError
from graspcast.training.settings import TrainingSettings


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"estimators": ("dens",)}, "did you mean 'dense'"),
        ({"estimators": ()}, "not none"),
        ({"estimators": ("dense", "dense")}, "each once; not dense, dense"),
        ({"images": 0}, "images: at least one is needed, not 0"),
        ({"validation_images": 0}, "validation images: at least one"),
        ({"steps": 0}, "steps: at least one"),
        ({"seed": -1}, "seed and threads are 0 or more"),
        ({"strength": 3.0}, "from 0 to 2, not 3.0"),
    ],
)
def test_wrong_settings_are_named(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(GraspcastError, match=message):
        TrainingSettings(**wrong)
