"""The flat arrays of the compiled code."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from graspcast.forecasting.models.mlp.network import Mlp
from graspcast.forecasting.models.mlp.packing import lay_out, network_of, pack, unpack
from graspcast.forecasting.models.mlp.simd import LANES


def test_the_layout_of_a_small_network() -> None:
    """Three inputs, five hidden units padded to eight, one output padded to four."""
    plan = lay_out((3, 5, 1))
    # inputs, outputs, offset of parameters, of inputs, of outputs
    assert plan.tolist() == [[3, 8, 0, 0, 4 * LANES], [8, 4, 4 * 8, 4 * LANES, 13 * LANES]]


def test_parameters_lie_input_by_input_with_the_bias_last() -> None:
    weight = np.array([[1, 2], [3, 4], [5, 6]], np.float32)
    last = np.array([[7, 8, 9]], np.float32)
    biases = (np.array([10, 11, 12], np.float32), np.array([13], np.float32))
    mlp = Mlp((weight, last), biases)
    expected = [1, 3, 5, 0, 2, 4, 6, 0, 10, 11, 12, 0]
    expected += [7, 0, 0, 0, 8, 0, 0, 0, 9, 0, 0, 0, 0, 0, 0, 0, 13, 0, 0, 0]
    assert pack(mlp, lay_out(mlp.widths)).tolist() == expected


@given(widths=st.lists(st.integers(1, 21), min_size=1, max_size=5), seed=st.integers(0, 2**40))
@settings(max_examples=40, deadline=None)
def test_unpacking_restores_the_network(widths: list[int], seed: int) -> None:
    mlp = Mlp.random(widths[0], widths[1:], seed)
    plan = lay_out(mlp.widths)
    again = unpack(pack(mlp, plan), plan, mlp.widths).to_arrays()
    for name, array in mlp.to_arrays().items():
        np.testing.assert_array_equal(again[name], array)


def test_a_row_of_ones_for_the_bias_follows_the_inputs_of_each_layer() -> None:
    network = network_of(Mlp.random(3, (5,), 0))
    rows = network.acts.reshape(-1, LANES)
    assert np.flatnonzero((rows == 1).all(axis=1)).tolist() == [3, 12]
    assert len(rows) == 17
