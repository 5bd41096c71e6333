"""SIMD operations against NumPy in float64."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numba import njit

from graspcast.forecasting.models.mlp import simd
from graspcast.forecasting.models.mlp.simd import (
    LANES,
    add_sums,
    broadcast,
    gather,
    load,
    multiply_add,
    store,
    where_positive,
    zeros,
)


def vectors(seed: int, count: int, scale: float = 1.0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, scale, count * LANES).astype(np.float32)


def apply(operation: Any, z: np.ndarray) -> np.ndarray:
    """One operation on all vectors of an array."""

    @njit
    def run(source: np.ndarray, target: np.ndarray) -> None:
        for start in range(0, len(source), LANES):
            store(target, start, operation(load(source, start)))

    out = np.empty_like(z)
    run(z, out)
    return out


EXTREMES = np.array([0, -0.0, 1e-30, -1e-30, 30, -30, 88, -88, 1e4, -1e4, 3e38, -3e38], np.float32)
Z = np.concatenate([EXTREMES, vectors(0, 63, 8.0), np.zeros(4, np.float32)])


def test_sigmoid() -> None:
    exact = 1 / (1 + np.exp(-np.clip(Z.astype(float), -700, 700)))
    np.testing.assert_allclose(apply(simd.sigmoid, Z), exact, rtol=1e-5, atol=1e-37)


def test_softplus() -> None:
    exact = np.logaddexp(0, Z.astype(float))
    np.testing.assert_allclose(apply(simd.softplus, Z), exact, rtol=1e-5, atol=1e-37)


@njit
def _arithmetic(a: np.ndarray, b: np.ndarray, c: np.ndarray, out: np.ndarray) -> None:
    store(out, 0, multiply_add(load(a, 0), broadcast(b, 3), load(c, 0)))
    store(out, LANES, where_positive(load(a, 0), load(c, 0)))
    store(out, 2 * LANES, zeros())


def test_arithmetic_and_selection() -> None:
    a, b, c = (vectors(seed, 1) for seed in (1, 2, 3))
    out = np.ones(3 * LANES, np.float32)
    _arithmetic(a, b, c, out)
    np.testing.assert_allclose(out[:LANES], a.astype(float) * b[3] + c, atol=1e-6)
    np.testing.assert_array_equal(out[LANES : 2 * LANES], np.where(a > 0, c, 0))
    assert not out[2 * LANES :].any()


@njit
def _gather(array: np.ndarray, places: np.ndarray, shift: int, out: np.ndarray) -> None:
    store(out, 0, gather(array, places, shift))


@pytest.mark.parametrize("shift", [0, 1, 7])
def test_gather(shift: int) -> None:
    array = vectors(4, 8)
    places = np.random.default_rng(5).integers(0, len(array) - 7, LANES)
    out = np.empty(LANES, np.float32)
    _gather(array, places, shift, out)
    np.testing.assert_array_equal(out, array[places + shift])


@njit
def _add_sums(rows: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    a, b = load(rows, 0), load(rows, LANES)
    c, d = load(rows, 2 * LANES), load(rows, 3 * LANES)
    add_sums(out, 1, a, b, c, d, load(x, 0))


def test_sums_over_lanes_are_added_to_four_elements() -> None:
    rows, x = vectors(6, 4), vectors(7, 1)
    out = np.arange(6, dtype=np.float32)
    _add_sums(rows, x, out)
    sums = rows.reshape(4, LANES).astype(float) @ x.astype(float)
    np.testing.assert_allclose(out, np.arange(6) + [0, *sums, 0], atol=1e-5)
