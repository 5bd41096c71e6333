"""A network: its probabilities, and its way into arrays and back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.models.mlp.network import Mlp, probability


@given(widths=st.lists(st.integers(1, 21), min_size=1, max_size=5), seed=st.integers(0, 2**40))
@settings(max_examples=40, deadline=None)
def test_arrays_restore_the_network(widths: list[int], seed: int) -> None:
    mlp = Mlp.random(widths[0], widths[1:], seed)
    assert mlp.widths == (*widths, 1)
    other = Mlp.from_arrays(mlp.to_arrays())
    assert other.widths == mlp.widths
    for name, array in mlp.to_arrays().items():
        np.testing.assert_array_equal(other.to_arrays()[name], array)


def test_arrays_survive_a_file(tmp_path: Path) -> None:
    mlp = Mlp.random(12, (16, 8, 4, 4), 0)
    np.savez(tmp_path / "mlp.npz", **mlp.to_arrays())
    x = np.random.default_rng(0).normal(size=(20, 12))
    with np.load(tmp_path / "mlp.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(Mlp.from_arrays(arrays).predict(x), mlp.predict(x))


def test_initial_parameters_are_uniform_within_the_bound_of_each_layer() -> None:
    mlp = Mlp.random(100, (400,), 0)
    for weight, bias, bound in zip(mlp.weights, mlp.biases, (0.1, 0.05), strict=True):
        assert np.abs(weight).max() <= bound
        assert np.abs(bias).max() <= bound
    assert mlp.weights[0].std() == pytest.approx(0.1 / np.sqrt(3), rel=0.01)
    assert mlp.biases[0].std() == pytest.approx(0.1 / np.sqrt(3), rel=0.1)


def test_probabilities_do_not_overflow() -> None:
    p = probability(np.array([-1e4, -1.0, 0.0, 1.0, 1e4], np.float32))
    np.testing.assert_allclose(p, [0, 1 / (1 + np.e), 0.5, np.e / (1 + np.e), 1], rtol=1e-7)


def test_rows_of_another_width_are_refused() -> None:
    with pytest.raises(MismatchError, match="12 inputs"):
        Mlp.random(12, (4,), 0).predict(np.zeros((3, 14)))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("weight_1", None),
        ("weight_1", np.zeros((1, 3))),
        ("bias_0", np.zeros(3)),
        ("bias_1", np.array([np.nan])),
    ],
)
def test_arrays_that_are_no_network_are_refused(name: str, value: np.ndarray | None) -> None:
    arrays = Mlp.random(12, (4,), 0).to_arrays()
    if value is None:
        del arrays[name]
    else:
        arrays[name] = value
    with pytest.raises(InputError):
        Mlp.from_arrays(arrays)
