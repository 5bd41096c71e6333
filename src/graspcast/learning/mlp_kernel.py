"""The compiled program that trains one small multilayer perceptron.

Sixteen samples are one variable: a value of the type *lanes* holds one unit's value for sixteen
samples, and LLVM turns it into whatever vector registers the processor has. Every layer is a loop
over such variables, so no array is allocated and no layer size is a compile-time constant: one
compilation serves every architecture and every number of inputs.

Everything is float32 in flat arrays. Of a layer with ``n_in`` inputs and ``n_out`` outputs,
padded to a multiple of four, the parameters are ``n_in + 1`` rows of ``n_out`` numbers, the last
row being the bias; padded outputs have zero parameters, zero activations and zero gradients. A
*plan* has one row a layer::

    n_in, n_out, offset of the parameters, offset of the inputs, offset of the outputs

where the offsets of inputs and outputs count in the buffer of activations and in that of their
derivatives (deltas); below the inputs of each layer stands one row of ones, for the bias.

It is all one file because numba's cache on disk notices a change of the file in which a function
stands, but not of another one from which it calls.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, models, register_model

__all__ = ["LANES", "QUAD", "gradient", "logits", "run_epochs"]

LANES = 16
QUAD = 4

_FLAGS = ("contract", "reassoc", "arcp", "nsz", "afn")
_SCALAR = ir.FloatType()
_VECTOR = ir.VectorType(_SCALAR, LANES)
_INT32 = ir.IntType(32)


def _compiled(function: Callable[..., Any]) -> Any:
    """Compile at the first call; keep the machine code on disk where a directory can be written."""
    options = {"nogil": True, "fastmath": set(_FLAGS), "error_model": "numpy"}
    try:
        return njit(cache=True, **options)(function)
    except RuntimeError:  # no directory for the cache can be written
        return njit(**options)(function)


# --- Lanes ---------------------------------------------------------------------------------------


class _Lanes(types.Type):  # type: ignore[misc]
    def __init__(self) -> None:
        super().__init__(name="graspcast.lanes")


_lanes = _Lanes()


@register_model(_Lanes)  # type: ignore[untyped-decorator]
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, frontend_type: Any) -> None:
        super().__init__(manager, frontend_type, _VECTOR)


def _constant(value: float) -> ir.Constant:
    return ir.Constant(_VECTOR, [np.float32(value)] * LANES)


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [index])


@intrinsic  # type: ignore[untyped-decorator]
def _load(typing_context: Any, array: Any, index: Any) -> Any:
    """Sixteen consecutive numbers of an array."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address = _address(context, builder, signature.args[0], *values)
        return builder.load(builder.bitcast(address, _VECTOR.as_pointer()), align=4)

    return _lanes(array, types.intp), generate


@intrinsic  # type: ignore[untyped-decorator]
def _store(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Write lanes to sixteen consecutive places of an array."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address = _address(context, builder, signature.args[0], *values[:2])
        builder.store(values[2], builder.bitcast(address, _VECTOR.as_pointer()), align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, _lanes), generate


def _splat(builder: Any, scalar: Any) -> Any:
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, scalar, _INT32(0))
    return builder.shuffle_vector(
        first, undefined, ir.Constant(ir.VectorType(_INT32, LANES), [0] * LANES)
    )


@intrinsic  # type: ignore[untyped-decorator]
def _everywhere(typing_context: Any, array: Any, index: Any) -> Any:
    """One number of an array in every lane."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address = _address(context, builder, signature.args[0], *values)
        return _splat(builder, builder.load(address, align=4))

    return _lanes(array, types.intp), generate


@intrinsic  # type: ignore[untyped-decorator]
def _zeros(typing_context: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _constant(0.0)

    return _lanes(), generate


@intrinsic  # type: ignore[untyped-decorator]
def _multiply_add(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """``a * b + c``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        product = builder.fmul(values[0], values[1], flags=_FLAGS)
        return builder.fadd(product, values[2], flags=_FLAGS)

    return _lanes(_lanes, _lanes, _lanes), generate


@intrinsic  # type: ignore[untyped-decorator]
def _where_positive(typing_context: Any, condition: Any, value: Any) -> Any:
    """``value`` where ``condition`` is above zero, else zero."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        positive = builder.fcmp_ordered(">", values[0], _constant(0.0))
        return builder.select(positive, values[1], _constant(0.0))

    return _lanes(_lanes, _lanes), generate


@intrinsic  # type: ignore[untyped-decorator]
def _add_sums(typing_context: Any, array: Any, index: Any, a: Any, b: Any, c: Any, d: Any, e: Any) -> Any:
    """Add the sums over the lanes of ``e * a, e * b, e * c, e * d`` to four consecutive places."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address = _address(context, builder, signature.args[0], *values[:2])
        rows = [builder.fmul(values[6], row, flags=_FLAGS) for row in values[2:6]]

        def pick(x: Any, y: Any, lanes: list[int]) -> Any:
            mask = ir.Constant(ir.VectorType(_INT32, len(lanes)), lanes)
            return builder.shuffle_vector(x, y, mask)

        def halves(x: Any, n: int) -> Any:
            return builder.fadd(
                pick(x, x, list(range(n // 2))), pick(x, x, list(range(n // 2, n))), flags=_FLAGS
            )

        def interleave(x: Any, y: Any) -> Any:
            # Within each group of four lanes: x0 + x1, x2 + x3, y0 + y1, y2 + y3.
            n = x.type.count
            even = [k + j + s for k in range(0, n, 4) for s in (0, n) for j in (0, 2)]
            odd = [k + 1 for k in even]
            return builder.fadd(pick(x, y, even), pick(x, y, odd), flags=_FLAGS)

        rows = [halves(row, LANES) for row in rows]
        total = interleave(interleave(rows[0], rows[1]), interleave(rows[2], rows[3]))
        total = halves(total, LANES // 2)
        place = builder.bitcast(address, ir.VectorType(_SCALAR, QUAD).as_pointer())
        total = builder.fadd(builder.load(place, align=4), total, flags=_FLAGS)
        builder.store(total, place, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, _lanes, _lanes, _lanes, _lanes, _lanes), generate


# --- One network ---------------------------------------------------------------------------------


@_compiled
def _dense(params, w, n_in, n_out, source, src, target, dst, rectify):
    for o in range(0, n_out, QUAD):
        k = w + n_in * n_out + o
        a = _everywhere(params, k)
        b = _everywhere(params, k + 1)
        c = _everywhere(params, k + 2)
        d = _everywhere(params, k + 3)
        k = w + o
        for i in range(n_in):
            x = _load(source, src + i * LANES)
            a = _multiply_add(_everywhere(params, k), x, a)
            b = _multiply_add(_everywhere(params, k + 1), x, b)
            c = _multiply_add(_everywhere(params, k + 2), x, c)
            d = _multiply_add(_everywhere(params, k + 3), x, d)
            k += n_out
        if rectify:
            a = _where_positive(a, a)
            b = _where_positive(b, b)
            c = _where_positive(c, c)
            d = _where_positive(d, d)
        t = dst + o * LANES
        _store(target, t, a)
        _store(target, t + LANES, b)
        _store(target, t + 2 * LANES, c)
        _store(target, t + 3 * LANES, d)


@_compiled
def _forward(params, plan, source, src, acts):
    """Fill the activations from one block of inputs; the logits end in the last layer's row."""
    last = plan.shape[0] - 1
    for layer in range(last + 1):
        n_in, n_out, w, at, dst = plan[layer]
        if layer == 0:
            _dense(params, w, n_in, n_out, source, src, acts, dst, last > 0)
        else:
            _dense(params, w, n_in, n_out, acts, at, acts, dst, layer < last)


@_compiled
def _backward(params, plan, acts, deltas, grads):
    """Add the gradient of one block to ``grads``, given the deltas of the last layer."""
    for layer in range(plan.shape[0] - 1, -1, -1):
        n_in, n_out, w, src, dst = plan[layer]
        for o in range(0, n_out, QUAD):
            t = dst + o * LANES
            a = _load(deltas, t)
            b = _load(deltas, t + LANES)
            c = _load(deltas, t + 2 * LANES)
            d = _load(deltas, t + 3 * LANES)
            for i in range(n_in + 1):
                x = _load(acts, src + i * LANES)
                _add_sums(grads, w + i * n_out + o, a, b, c, d, x)
        if layer == 0:
            break
        for i in range(0, n_in, QUAD):
            k = w + i * n_out
            a = _zeros()
            b = _zeros()
            c = _zeros()
            d = _zeros()
            for o in range(n_out):
                x = _load(deltas, dst + o * LANES)
                a = _multiply_add(_everywhere(params, k + o), x, a)
                b = _multiply_add(_everywhere(params, k + n_out + o), x, b)
                c = _multiply_add(_everywhere(params, k + 2 * n_out + o), x, c)
                d = _multiply_add(_everywhere(params, k + 3 * n_out + o), x, d)
            t = src + i * LANES
            _store(deltas, t, _where_positive(_load(acts, t), a))
            t += LANES
            _store(deltas, t, _where_positive(_load(acts, t), b))
            t += LANES
            _store(deltas, t, _where_positive(_load(acts, t), c))
            t += LANES
            _store(deltas, t, _where_positive(_load(acts, t), d))


@_compiled
def _batch_gradient(params, plan, inputs, labels, order, start, stop, acts, deltas, grads):
    """The gradient of the mean binary cross-entropy of the samples ``order[start:stop]``."""
    out = plan[-1, 4]
    width = plan[0, 0]
    weight = np.float32(1.0 / (stop - start))
    grads[:] = np.float32(0.0)
    for first in range(start, stop, LANES):
        count = min(LANES, stop - first)
        for s in range(LANES):
            # Lanes without a sample repeat one; their delta is zero.
            row = order[first + min(s, count - 1)] * width
            for i in range(width):
                acts[i * LANES + s] = inputs[row + i]
        _forward(params, plan, acts, 0, acts)
        for s in range(LANES):
            if s < count:
                p = np.float32(1.0) / (np.float32(1.0) + math.exp(-acts[out + s]))
                deltas[out + s] = (p - labels[order[first + s]]) * weight
            else:
                deltas[out + s] = np.float32(0.0)
        _backward(params, plan, acts, deltas, grads)


@_compiled
def gradient(params, plan, inputs, labels, order, acts, deltas, grads):
    _batch_gradient(params, plan, inputs, labels, order, 0, len(order), acts, deltas, grads)


@_compiled
def logits(params, plan, blocks, acts, out):
    """Logits of held-out samples, given as blocks of lanes (block, input, sample), flattened."""
    size = plan[0, 0] * LANES
    at = plan[-1, 4]
    for block in range(out.shape[0] // LANES):
        _forward(params, plan, blocks, block * size, acts)
        _store(out, block * LANES, _load(acts, at))


@_compiled
def _adam(params, grads, m, v, step, epsilon, beta1, beta2):
    rest1 = np.float32(1.0) - beta1
    rest2 = np.float32(1.0) - beta2
    for k in range(params.shape[0]):
        g = grads[k]
        m[k] = beta1 * m[k] + rest1 * g
        v[k] = beta2 * v[k] + rest2 * g * g
        params[k] -= step * m[k] / (np.sqrt(v[k]) + epsilon)


@_compiled
def _shuffle(order, state):
    """Fisher–Yates; SplitMix64 (Steele, Lea, Flood 2014) draws the numbers."""
    z0 = state[0]
    for k in range(len(order) - 1, 0, -1):
        z0 += np.uint64(0x9E3779B97F4A7C15)
        z = z0
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
        # The high half times the range, shifted: uniform to 2^-32 without a division.
        j = np.int64(((z >> np.uint64(32)) * np.uint64(k + 1)) >> np.uint64(32))
        order[k], order[j] = order[j], order[k]
    state[0] = z0


@_compiled
def run_epochs(
    first, last, rates, batch, beta1, beta2, epsilon,
    params, m, v, random, plan, inputs, labels, order, acts, deltas, grads,
    blocks, truth, groups, out, correct, loss, slots, kept_epoch, kept_score, kept_params,
):
    n = len(order)
    steps = first * ((n + batch - 1) // batch)
    for epoch in range(first, last):
        _shuffle(order, random)
        for start in range(0, n, batch):
            stop = min(n, start + batch)
            _batch_gradient(params, plan, inputs, labels, order, start, stop, acts, deltas, grads)
            steps += 1
            c1 = 1.0 - beta1**steps
            c2 = math.sqrt(1.0 - beta2**steps)
            _adam(params, grads, m, v, np.float32(rates[epoch] * c2 / c1), np.float32(epsilon * c2),
                  np.float32(beta1), np.float32(beta2))
        logits(params, plan, blocks, acts, out)
        for s in range(len(truth)):
            z = out[s]
            g = groups[s]
            if (z > 0) == truth[s]:
                correct[epoch, g] += 1
            # log(1 + exp(z)) - z y, without overflow.
            loss[epoch, g] += max(z, 0.0) - z * truth[s] + math.log1p(math.exp(-abs(z)))
        for k in range(len(slots)):
            score = 0.0
            for g in range(slots[k, 0], slots[k, 1]):
                score += correct[epoch, g] if slots[k, 2] == 0 else -loss[epoch, g]
            if score > kept_score[k]:
                kept_score[k] = score
                kept_epoch[k] = epoch + 1
                kept_params[k] = params
