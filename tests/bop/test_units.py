"""Millimetres and metres."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_array_equal

from graspcast.bop.units import metres, millimetres


@given(arrays(np.float64, 20, elements=st.floats(-2e4, 2e4, allow_subnormal=False)))
def test_metres_written_as_millimetres_are_the_same_metres(length_mm: np.ndarray) -> None:
    length_m = metres(length_mm)
    assert_array_equal(metres(millimetres(length_m)), length_m)
