"""The compiled kernel against a float64 implementation with numeric gradients."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.forecasting.models.mlp.kernel import batch_gradient
from graspcast.forecasting.models.mlp.network import Mlp
from graspcast.forecasting.models.mlp.packing import network_of, pack, training_on
from graspcast.forecasting.models.mlp.types import (
    Problem,
)
from mlp_reference import as_mlp, numeric_gradient, parameters64


def samples(seed: int, n: int, d: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """Inputs, and labels that a line through them separates, but for some noise."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(n, d)).astype(np.float32)
    return x, x @ rng.normal(size=d) + 0.3 * rng.normal(size=n) > 0


@pytest.mark.parametrize("hidden", [(16, 8, 4, 4), (5,), (3, 7), ()])
@pytest.mark.parametrize("n", [16, 1, 13, 37])
def test_the_gradient_is_that_of_finite_differences(hidden: tuple[int, ...], n: int) -> None:
    x, y = samples(n, n, 6)
    mlp = Mlp.random(6, hidden, seed=n)
    network = network_of(mlp)
    training = training_on(Problem(x, y), len(network.params))
    batch_gradient(network, training, 0, n)
    expected = pack(as_mlp(numeric_gradient(parameters64(mlp), x, y)), network.plan)
    assert np.abs(expected).max() > 1e-3
    np.testing.assert_allclose(training.grads, expected, atol=3e-6)


def test_a_batch_is_the_samples_that_the_order_names() -> None:
    x, y = samples(0, 50)
    mlp = Mlp.random(12, (16, 8), seed=0)
    network = network_of(mlp)
    training = training_on(Problem(x, y), len(network.params))
    training.order[:] = np.random.default_rng(1).permutation(50)
    batch_gradient(network, training, 10, 30)
    chosen = training.order[10:30]
    whole = training_on(Problem(x[chosen], y[chosen]), len(network.params))
    batch_gradient(network, whole, 0, 20)
    np.testing.assert_array_equal(training.grads, whole.grads)
