from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from graspcast.errors import InputError
from solids import box


def test_impossible_objects_are_refused() -> None:
    for wrong, message in (
        ({"mass_kg": 0.0}, "its mass is 0.0 kg"),
        ({"mass_kg": math.nan}, "its mass is nan kg"),
        ({"friction": -0.1}, "its friction is -0.1"),
        ({"pieces": ()}, "no collision piece"),
        ({"inertia": np.zeros((3, 3))}, "not positive definite"),
        ({"sim_T_ref": np.full((4, 4), math.nan)}, "reference pose must be a finite"),
    ):
        with pytest.raises(InputError, match=message):
            replace(box(), **wrong)
