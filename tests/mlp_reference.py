"""Small networks for comparison: float64, one sample after the other, numeric gradients."""

from __future__ import annotations

import numpy as np

from graspcast.forecasting.models.mlp.network import Mlp


def loss64(parameters: list[np.ndarray], x: np.ndarray, y: np.ndarray) -> float:
    """The mean binary cross-entropy; parameters are weight, bias, weight, bias, …"""
    h = x.astype(float)
    for k in range(0, len(parameters), 2):
        h = h @ parameters[k].T + parameters[k + 1]
        h = np.maximum(h, 0) if k < len(parameters) - 2 else h
    p = 1 / (1 + np.exp(-h[:, 0]))
    return float(-np.mean(np.where(y, np.log(p), np.log1p(-p))))


def parameters64(mlp: Mlp) -> list[np.ndarray]:
    pairs = zip(mlp.weights, mlp.biases, strict=True)
    return [array.astype(float) for pair in pairs for array in pair]


def numeric_gradient(
    parameters: list[np.ndarray], x: np.ndarray, y: np.ndarray
) -> list[np.ndarray]:
    gradient = [np.zeros_like(array) for array in parameters]
    for array, slope in zip(parameters, gradient, strict=True):
        for place in np.ndindex(array.shape):
            value = array[place]
            array[place] = value + 1e-6
            above = loss64(parameters, x, y)
            array[place] = value - 1e-6
            slope[place] = (above - loss64(parameters, x, y)) / 2e-6
            array[place] = value
    return gradient


def as_mlp(parameters: list[np.ndarray]) -> Mlp:
    return Mlp(tuple(parameters[::2]), tuple(parameters[1::2]))
