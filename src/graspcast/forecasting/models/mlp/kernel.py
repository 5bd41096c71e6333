"""The compiled training loop of one small multilayer perceptron.

One SIMD vector holds one unit's value for sixteen samples
(:mod:`graspcast.forecasting.models.mlp.simd`). Each layer is a loop over such vectors; no array is
allocated, and no layer's size is a compile-time constant, so one compilation serves every
architecture and every number of inputs.

All numbers are float32 in flat arrays. The parameters of a layer with ``n_in`` inputs and ``n_out``
outputs (padded to a multiple of four) are ``n_in + 1`` rows of ``n_out`` numbers; the last row is
the bias. Padded outputs have zero parameters, zero activations and zero gradients. The plan of a
network has one row for each layer::

    n_in, n_out, offset of the parameters, offset of the inputs, offset of the outputs

The last two are offsets into the buffer of activations, and into the buffer of the loss's
derivatives with respect to them (deltas). A row of ones for the bias follows the inputs of each
layer.
"""

from __future__ import annotations

import inspect
import math
import zlib
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, UInt64
from numpy import ndarray

from graspcast.forecasting.models.mlp import simd
from graspcast.forecasting.models.mlp.simd import (
    LANES,
    QUAD,
    add_sums,
    broadcast,
    gather,
    load,
    multiply_add,
    sigmoid,
    softplus,
    store,
    where_positive,
    zeros,
)
from graspcast.io.compiling import cached_njit

__all__ = [
    "History",
    "Network",
    "Optimiser",
    "Training",
    "Validation",
    "batch_gradient",
    "evaluate",
    "run_epochs",
]


def _compiled(function: Callable[..., None]) -> Callable[..., None]:
    """Compile at the first call, and cache the machine code on disk if possible."""
    options: dict[str, Any] = {
        "nogil": True,
        "_nrt": False,
        "fastmath": set(simd.FAST),
        "error_model": "numpy",
    }
    # Run-time type checking in tests wraps functions; the wrapper cannot be compiled.
    function = inspect.unwrap(function)
    with suppress(OSError):  # no source file
        # numba's cache is invalidated by changes of this file, but not by those of simd.
        function.__qualname__ += f"_{zlib.crc32(inspect.getsource(simd).encode()):08x}"
    compiled: Callable[..., None] = cached_njit(**options)(function)
    return compiled


class Network(NamedTuple):
    """Plan and parameters of a network, and buffers for one block of samples."""

    plan: Int64[ndarray, "layers 5"]
    params: Float32[ndarray, " params"]
    acts: Float32[ndarray, " rows*lanes"]
    deltas: Float32[ndarray, " rows*lanes"]


class Training(NamedTuple):
    """Training samples, their order, and the state of the optimiser."""

    inputs: Float32[ndarray, " n*d"]
    labels: Float32[ndarray, " n"]
    order: Int64[ndarray, " n"]
    places: Int64[ndarray, " lanes"]
    random: UInt64[ndarray, " 1"]
    grads: Float32[ndarray, " params"]
    mean: Float32[ndarray, " params"]
    square: Float32[ndarray, " params"]


class Optimiser(NamedTuple):
    """Constants of Adam, and the learning rate of every epoch."""

    rates: Float64[ndarray, " epochs"]
    batch: int
    beta1: float
    beta2: float
    epsilon: float


class Validation(NamedTuple):
    """Validation samples, evaluated after every epoch, in blocks: (block, input, sample), flat."""

    blocks: Float32[ndarray, " blocks*d*lanes"]
    labels: Bool[ndarray, " m"]
    groups: Int64[ndarray, " m"]
    logits: Float32[ndarray, " blocks*lanes"]
    softplus: Float32[ndarray, " blocks*lanes"]


class History(NamedTuple):
    """Validation curves, and the best checkpoint by each of several criteria.

    A row of ``criteria`` is: first group, one past the last group, and 0 for the number of hits or
    1 for the negative loss. A higher score is better; of equal scores the first is kept.
    """

    hits: Int32[ndarray, "epochs groups"]
    loss: Float64[ndarray, "epochs groups"]
    criteria: Int64[ndarray, "criteria 3"]
    epochs: Int64[ndarray, " criteria"]
    scores: Float64[ndarray, " criteria"]
    params: Float32[ndarray, "criteria params"]


@_compiled
def _dense(
    params: ndarray, w: int, n_in: int, n_out: int,
    source: ndarray, src: int, target: ndarray, dst: int, rectify: bool,
) -> None:  # fmt: skip
    """Evaluate one layer, four outputs at a time so that each input is read once for four."""
    for o in range(0, n_out, QUAD):
        k = w + n_in * n_out + o
        a = broadcast(params, k)
        b = broadcast(params, k + 1)
        c = broadcast(params, k + 2)
        d = broadcast(params, k + 3)
        k = w + o
        for i in range(n_in):
            x = load(source, src + i * LANES)
            a = multiply_add(broadcast(params, k), x, a)
            b = multiply_add(broadcast(params, k + 1), x, b)
            c = multiply_add(broadcast(params, k + 2), x, c)
            d = multiply_add(broadcast(params, k + 3), x, d)
            k += n_out
        if rectify:
            a = where_positive(a, a)
            b = where_positive(b, b)
            c = where_positive(c, c)
            d = where_positive(d, d)
        t = dst + o * LANES
        store(target, t, a)
        store(target, t + LANES, b)
        store(target, t + 2 * LANES, c)
        store(target, t + 3 * LANES, d)


@_compiled
def _forward(network: Network, source: ndarray, src: int) -> None:
    """Compute the activations of one block of inputs; those of the last layer are logits."""
    plan, params, acts = network.plan, network.params, network.acts
    last = plan.shape[0] - 1
    for layer in range(last + 1):
        n_in, n_out, w, at, dst = plan[layer]
        if layer == 0:
            _dense(params, w, n_in, n_out, source, src, acts, dst, layer < last)
        else:
            _dense(params, w, n_in, n_out, acts, at, acts, dst, layer < last)


@_compiled
def _backward(network: Network, grads: ndarray) -> None:
    """Add the gradient of one block to ``grads``, given the deltas of the last layer."""
    plan, params, acts, deltas = network.plan, network.params, network.acts, network.deltas
    for layer in range(plan.shape[0] - 1, -1, -1):
        n_in, n_out, w, src, dst = plan[layer]
        for o in range(0, n_out, QUAD):
            t = dst + o * LANES
            a = load(deltas, t)
            b = load(deltas, t + LANES)
            c = load(deltas, t + 2 * LANES)
            d = load(deltas, t + 3 * LANES)
            for i in range(n_in + 1):
                x = load(acts, src + i * LANES)
                add_sums(grads, w + i * n_out + o, a, b, c, d, x)
        if layer == 0:
            break
        for i in range(0, n_in, QUAD):
            k = w + i * n_out
            a = zeros()
            b = zeros()
            c = zeros()
            d = zeros()
            for o in range(n_out):
                x = load(deltas, dst + o * LANES)
                a = multiply_add(broadcast(params, k + o), x, a)
                b = multiply_add(broadcast(params, k + n_out + o), x, b)
                c = multiply_add(broadcast(params, k + 2 * n_out + o), x, c)
                d = multiply_add(broadcast(params, k + 3 * n_out + o), x, d)
            t = src + i * LANES
            store(deltas, t, where_positive(load(acts, t), a))
            t += LANES
            store(deltas, t, where_positive(load(acts, t), b))
            t += LANES
            store(deltas, t, where_positive(load(acts, t), c))
            t += LANES
            store(deltas, t, where_positive(load(acts, t), d))


@_compiled
def batch_gradient(network: Network, training: Training, start: int, stop: int) -> None:
    """Set ``grads`` to the gradient of the mean binary cross-entropy of ``order[start:stop]``."""
    inputs, labels, order, places = (
        training.inputs, training.labels, training.order, training.places,
    )  # fmt: skip
    acts, deltas, grads = network.acts, network.deltas, training.grads
    width, out = network.plan[0, 0], network.plan[-1, 4]
    weight = np.float32(1.0 / (stop - start))
    for k in range(grads.shape[0]):
        grads[k] = np.float32(0.0)
    for first in range(start, stop, LANES):
        count = min(LANES, stop - first)
        for s in range(LANES):
            # Lanes without a sample repeat the last sample, with a delta of zero.
            places[s] = order[first + min(s, count - 1)] * width
        for i in range(width):
            store(acts, i * LANES, gather(inputs, places, i))
        _forward(network, acts, 0)
        store(deltas, out, sigmoid(load(acts, out)))
        for s in range(count):
            deltas[out + s] = (deltas[out + s] - labels[order[first + s]]) * weight
        for s in range(count, LANES):
            deltas[out + s] = np.float32(0.0)
        _backward(network, grads)


@_compiled
def evaluate(network: Network, validation: Validation) -> None:
    """Compute the logits of validation samples and their softplus."""
    size = network.plan[0, 0] * LANES
    out = network.plan[-1, 4]
    for block in range(validation.logits.shape[0] // LANES):
        _forward(network, validation.blocks, block * size)
        z = load(network.acts, out)
        store(validation.logits, block * LANES, z)
        store(validation.softplus, block * LANES, softplus(z))


@_compiled
def _adam(
    params: ndarray, training: Training, rate: float, epsilon: float, beta1: float, beta2: float
) -> None:
    """Update the parameters by Adam (Kingma and Ba 2015, algorithm 1, as ordered in section 2)."""
    grads, mean, square = training.grads, training.mean, training.square
    r, e = np.float32(rate), np.float32(epsilon)
    b1, b2 = np.float32(beta1), np.float32(beta2)
    c1, c2 = np.float32(1.0 - beta1), np.float32(1.0 - beta2)
    for k in range(params.shape[0]):
        g = grads[k]
        mean[k] = b1 * mean[k] + c1 * g
        square[k] = b2 * square[k] + c2 * g * g
        params[k] -= r * mean[k] / (np.sqrt(square[k]) + e)


@_compiled
def _shuffle(order: ndarray, random: ndarray) -> None:
    """Shuffle (Fisher and Yates) with random numbers by SplitMix64 (Steele et al. 2014)."""
    state = random[0]
    for k in range(order.shape[0] - 1, 0, -1):
        state += np.uint64(0x9E3779B97F4A7C15)
        z = state
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
        # The high half times the range, shifted: uniform to within 2^-32, without a division.
        j = np.int64(((z >> np.uint64(32)) * np.uint64(k + 1)) >> np.uint64(32))
        order[k], order[j] = order[j], order[k]
    random[0] = state


@_compiled
def _validate(network: Network, validation: Validation, history: History, epoch: int) -> None:
    """Compute one row of the validation curves, and save parameters that are the best so far."""
    evaluate(network, validation)
    for s in range(validation.labels.shape[0]):
        z, label, group = validation.logits[s], validation.labels[s], validation.groups[s]
        history.hits[epoch, group] += np.int32((z > 0) == label)
        # Binary cross-entropy: log(1 + exp(z)) - z y.
        history.loss[epoch, group] += validation.softplus[s] - (z if label else np.float32(0.0))
    for k in range(history.criteria.shape[0]):
        first, stop, of_loss = history.criteria[k]
        score = 0.0
        for group in range(first, stop):
            score += -history.loss[epoch, group] if of_loss else history.hits[epoch, group]
        if score > history.scores[k]:
            history.scores[k] = score
            history.epochs[k] = epoch + 1
            for i in range(network.params.shape[0]):
                history.params[k, i] = network.params[i]


@_compiled
def run_epochs(
    first: int, stop: int, optimiser: Optimiser, network: Network, training: Training,
    validation: Validation, history: History,
) -> None:  # fmt: skip
    """Train from epoch ``first`` (counted from zero) up to, not including, ``stop``."""
    n = training.order.shape[0]
    batch, beta1, beta2 = optimiser.batch, optimiser.beta1, optimiser.beta2
    steps = first * ((n + batch - 1) // batch)
    decay1, decay2 = beta1**steps, beta2**steps
    for epoch in range(first, stop):
        _shuffle(training.order, training.random)
        for start in range(0, n, batch):
            batch_gradient(network, training, start, min(n, start + batch))
            decay1 *= beta1
            decay2 *= beta2
            unbias = math.sqrt(1.0 - decay2)
            rate = optimiser.rates[epoch] * unbias / (1.0 - decay1)
            _adam(network.params, training, rate, optimiser.epsilon * unbias, beta1, beta2)
        _validate(network, validation, history, epoch)
