"""The compiled program that trains one small multilayer perceptron.

One variable holds one unit's value for sixteen samples
(:mod:`graspcast.forecasting.models.mlp.simd`), every layer is a loop over such variables, no
array is allocated, and no layer's size is a constant of the compilation: one
compilation serves every architecture and every number of inputs.

Everything is float32 in flat arrays. Of a layer with ``n_in`` inputs and ``n_out`` outputs,
padded to a multiple of four, the parameters are ``n_in + 1`` rows of ``n_out`` numbers, the last
row being the bias; padded outputs have zero parameters, zero activations and zero gradients. The
plan of a network has one row a layer::

    n_in, n_out, offset of the parameters, offset of the inputs, offset of the outputs

where the last two count in the buffer of activations and in that of the loss's derivatives with
respect to them (deltas). Below the inputs of a layer stands one row of ones, for the bias.
"""

from __future__ import annotations

import inspect
import math
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32, Int64, UInt64
from numba import njit
from numpy import ndarray

from graspcast.forecasting.models.mlp import simd
from graspcast.forecasting.models.mlp.simd import (
    LANES,
    QUAD,
    add_sums,
    everywhere,
    gather,
    load,
    multiply_add,
    sigmoid,
    softplus,
    store,
    where_positive,
    zeros,
)

__all__ = [
    "HeldOut",
    "Kept",
    "Network",
    "Optimiser",
    "Training",
    "batch_gradient",
    "evaluate",
    "run_epochs",
]


def _compiled(function: Callable[..., None]) -> Callable[..., None]:
    """Compile at the first call; keep the machine code on disk where a directory can be written."""
    options: dict[str, Any] = {
        "nogil": True,
        "_nrt": False,
        "fastmath": set(simd.FAST),
        "error_model": "numpy",
    }
    # A checker of types at run time wraps functions, but cannot be compiled.
    function = inspect.unwrap(function)
    try:
        # numba's cache notices a change of this file, but not of the one with the lanes.
        function.__qualname__ += f"_{zlib.crc32(inspect.getsource(simd).encode()):08x}"
        compiled: Callable[..., None] = njit(cache=True, **options)(function)
    except (OSError, RuntimeError):  # no source to compare with, or no directory to write to
        compiled = njit(**options)(function)
    return compiled


class Network(NamedTuple):
    """Parameters, and room for one block of samples."""

    plan: Int64[ndarray, "layers 5"]
    params: Float32[ndarray, "params"]
    acts: Float32[ndarray, " rows*lanes"]
    deltas: Float32[ndarray, " rows*lanes"]


class Training(NamedTuple):
    """Samples, the order in which they come, and the state of the optimiser."""

    inputs: Float32[ndarray, " n*d"]
    labels: Float32[ndarray, "n"]
    order: Int64[ndarray, "n"]
    places: Int64[ndarray, "lanes"]
    random: UInt64[ndarray, " 1"]
    grads: Float32[ndarray, "params"]
    mean: Float32[ndarray, "params"]
    square: Float32[ndarray, "params"]


class Optimiser(NamedTuple):
    """Adam's constants, and the learning rate of every epoch."""

    rates: Float64[ndarray, "epochs"]
    batch: int
    beta1: float
    beta2: float
    epsilon: float


class HeldOut(NamedTuple):
    """Samples to look at after every epoch, in blocks of lanes: (block, input, sample), flat."""

    blocks: Float32[ndarray, " blocks*d*lanes"]
    labels: Bool[ndarray, "m"]
    groups: Int64[ndarray, "m"]
    logits: Float32[ndarray, " blocks*lanes"]
    softplus: Float32[ndarray, " blocks*lanes"]


class Kept(NamedTuple):
    """Curves, and the best checkpoint by each of several criteria.

    A row of ``criteria`` is: first group, one past the last group, 0 for the number of hits or 1
    for the negative loss. The higher score is better; of equal ones the first stays.
    """

    hits: Int32[ndarray, "epochs groups"]
    loss: Float64[ndarray, "epochs groups"]
    criteria: Int64[ndarray, "criteria 3"]
    epochs: Int64[ndarray, "criteria"]
    scores: Float64[ndarray, "criteria"]
    params: Float32[ndarray, "criteria params"]


@_compiled
def _dense(
    params: ndarray, w: int, n_in: int, n_out: int,
    source: ndarray, src: int, target: ndarray, dst: int, rectify: bool,
) -> None:  # fmt: skip
    """One layer, four outputs at a time so that each input is read once for four."""
    for o in range(0, n_out, QUAD):
        k = w + n_in * n_out + o
        a = everywhere(params, k)
        b = everywhere(params, k + 1)
        c = everywhere(params, k + 2)
        d = everywhere(params, k + 3)
        k = w + o
        for i in range(n_in):
            x = load(source, src + i * LANES)
            a = multiply_add(everywhere(params, k), x, a)
            b = multiply_add(everywhere(params, k + 1), x, b)
            c = multiply_add(everywhere(params, k + 2), x, c)
            d = multiply_add(everywhere(params, k + 3), x, d)
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
    """Fill the activations from one block of inputs; the last layer holds logits."""
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
                a = multiply_add(everywhere(params, k + o), x, a)
                b = multiply_add(everywhere(params, k + n_out + o), x, b)
                c = multiply_add(everywhere(params, k + 2 * n_out + o), x, c)
                d = multiply_add(everywhere(params, k + 3 * n_out + o), x, d)
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
            # Lanes without a sample repeat the last one; their delta is zero.
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
def evaluate(network: Network, held_out: HeldOut) -> None:
    """Fill the logits of held-out samples and their softplus."""
    size = network.plan[0, 0] * LANES
    out = network.plan[-1, 4]
    for block in range(held_out.logits.shape[0] // LANES):
        _forward(network, held_out.blocks, block * size)
        z = load(network.acts, out)
        store(held_out.logits, block * LANES, z)
        store(held_out.softplus, block * LANES, softplus(z))


@_compiled
def _adam(
    params: ndarray, training: Training, rate: float, epsilon: float, beta1: float, beta2: float
) -> None:
    """Kingma and Ba 2015, algorithm 1 in the order of the end of their section 2."""
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
    """Fisher and Yates's shuffle; SplitMix64 (Steele, Lea and Flood 2014) draws the numbers."""
    state = random[0]
    for k in range(order.shape[0] - 1, 0, -1):
        state += np.uint64(0x9E3779B97F4A7C15)
        z = state
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
        # The high half times the range, shifted: uniform to 2^-32 without a division.
        j = np.int64(((z >> np.uint64(32)) * np.uint64(k + 1)) >> np.uint64(32))
        order[k], order[j] = order[j], order[k]
    random[0] = state


@_compiled
def _look(network: Network, held_out: HeldOut, kept: Kept, epoch: int) -> None:
    """Fill one row of the curves, and keep the parameters wherever they are the best so far."""
    evaluate(network, held_out)
    for s in range(held_out.labels.shape[0]):
        z, label, group = held_out.logits[s], held_out.labels[s], held_out.groups[s]
        kept.hits[epoch, group] += np.int32((z > 0) == label)
        # Binary cross-entropy: log(1 + exp(z)) - z y.
        kept.loss[epoch, group] += held_out.softplus[s] - (z if label else np.float32(0.0))
    for k in range(kept.criteria.shape[0]):
        first, stop, of_loss = kept.criteria[k]
        score = 0.0
        for group in range(first, stop):
            score += -kept.loss[epoch, group] if of_loss else kept.hits[epoch, group]
        if score > kept.scores[k]:
            kept.scores[k] = score
            kept.epochs[k] = epoch + 1
            for i in range(network.params.shape[0]):
                kept.params[k, i] = network.params[i]


@_compiled
def run_epochs(
    first: int, stop: int, optimiser: Optimiser, network: Network, training: Training,
    held_out: HeldOut, kept: Kept,
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
        _look(network, held_out, kept, epoch)
