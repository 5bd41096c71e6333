"""SIMD vectors of sixteen float32 numbers, and operations on them, for code compiled by numba.

Inside compiled functions a value of the type *lanes* is an LLVM vector, which LLVM maps to the
vector registers of the processor. Operations may be fused and reordered, so results may differ in
the last bits between machines, but not between runs on one machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, models, register_model

__all__ = [
    "FAST",
    "LANES",
    "QUAD",
    "add_sums",
    "broadcast",
    "gather",
    "load",
    "multiply_add",
    "sigmoid",
    "softplus",
    "store",
    "where_positive",
    "zeros",
]

LANES = 16
QUAD = 4

# LLVM's fast-math flags, except those that assume that there are no NaN and no infinities.
FAST = ("contract", "reassoc", "arcp", "nsz", "afn")

_SCALAR = ir.FloatType()
_VECTOR = ir.VectorType(_SCALAR, LANES)
_INT32 = ir.IntType(32)


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__(name="graspcast.lanes")


_lanes = _Lanes()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, frontend_type: Any) -> None:
        super().__init__(manager, frontend_type, _VECTOR)  # type: ignore[no-untyped-call]


def _operation(typing: Callable[..., Any]) -> Callable[..., Any]:
    """Register an intrinsic; compiled callers pass every argument but the first, the context."""
    compiled: Callable[..., Any] = intrinsic(typing)
    return compiled


def _constant(value: float) -> ir.Constant:
    return ir.Constant(_VECTOR, [np.float32(value)] * LANES)


def _address(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
    data = context.make_array(array_type)(context, builder, array).data
    return builder.gep(data, [index])


@_operation
def load(typing_context: Any, array: Any, index: Any) -> Any:
    """Load sixteen consecutive numbers of an array."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address = _address(context, builder, signature.args[0], *values)
        return builder.load(builder.bitcast(address, _VECTOR.as_pointer()), align=4)

    return _lanes(array, types.intp), generate


@_operation
def store(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
    """Store a vector in sixteen consecutive elements of an array."""

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


@_operation
def broadcast(typing_context: Any, array: Any, index: Any) -> Any:
    """Load one number of an array into every lane."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address = _address(context, builder, signature.args[0], *values)
        return _splat(builder, builder.load(address, align=4))

    return _lanes(array, types.intp), generate


@_operation
def zeros(typing_context: Any) -> Any:
    """Return a vector of zeros."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _constant(0.0)

    return _lanes(), generate


@_operation
def multiply_add(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Compute ``a * b + c``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        product = builder.fmul(values[0], values[1], flags=FAST)
        return builder.fadd(product, values[2], flags=FAST)

    return _lanes(_lanes, _lanes, _lanes), generate


@_operation
def where_positive(typing_context: Any, condition: Any, value: Any) -> Any:
    """Select ``value`` where ``condition`` is above zero, else zero."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        positive = builder.fcmp_ordered(">", values[0], _constant(0.0))
        return builder.select(positive, values[1], _constant(0.0))

    return _lanes(_lanes, _lanes), generate


@_operation
def gather(typing_context: Any, array: Any, places: Any, shift: Any) -> Any:
    """Load ``array[places[s] + shift]`` into each lane ``s``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        start = _address(context, builder, signature.args[0], values[0], values[2])
        value = ir.Constant(_VECTOR, ir.Undefined)
        for lane in range(LANES):
            index = ir.Constant(values[2].type, lane)
            place = builder.load(_address(context, builder, signature.args[1], values[1], index))
            scalar = builder.load(builder.gep(start, [place]), align=4)
            value = builder.insert_element(value, scalar, _INT32(lane))
        return value

    return _lanes(array, places, types.intp), generate


def _horner(builder: Any, x: Any, coefficients: list[float]) -> Any:
    """Evaluate a polynomial (Horner); the constant term comes first."""
    total = _constant(coefficients[-1])
    for coefficient in reversed(coefficients[:-1]):
        product = builder.fmul(total, x, flags=FAST)
        total = builder.fadd(product, _constant(coefficient), flags=FAST)
    return total


def _exp_minus_magnitude(builder: Any, z: Any) -> Any:
    """Compute ``exp(-|z|)`` as a power of two (set in the exponent bits) times a polynomial."""
    above = builder.fcmp_ordered(">", z, _constant(0.0))
    magnitude = builder.select(above, z, builder.fsub(_constant(0.0), z))
    # Beyond 87 the result would be subnormal.
    small = builder.fcmp_ordered("<", magnitude, _constant(87.0))
    magnitude = builder.select(small, magnitude, _constant(87.0))
    power = builder.fmul(magnitude, _constant(-1.0 / math.log(2.0)))
    # Truncation after subtracting 1/2 rounds to the nearest integer, as no power is positive.
    integers = ir.VectorType(_INT32, LANES)
    integer = builder.fptosi(builder.fsub(power, _constant(0.5)), integers)
    whole = builder.sitofp(integer, _VECTOR)
    # Taylor series of 2^x in [-1/2, 1/2]; the first omitted term is below 6e-9.
    terms = [math.log(2.0) ** k / math.factorial(k) for k in range(8)]
    fraction = _horner(builder, builder.fsub(power, whole), terms)
    exponent = builder.add(integer, ir.Constant(integers, [127] * LANES))
    bits = builder.shl(exponent, ir.Constant(integers, [23] * LANES))
    return builder.fmul(fraction, builder.bitcast(bits, _VECTOR), flags=FAST)


@_operation
def sigmoid(typing_context: Any, z: Any) -> Any:
    """Compute ``1 / (1 + exp(-z))``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        e = _exp_minus_magnitude(builder, values[0])
        above = builder.fcmp_ordered(">", values[0], _constant(0.0))
        numerator = builder.select(above, _constant(1.0), e)
        return builder.fdiv(numerator, builder.fadd(e, _constant(1.0)))

    return _lanes(_lanes), generate


@_operation
def softplus(typing_context: Any, z: Any) -> Any:
    """Compute ``log(1 + exp(z)) = max(z, 0) + log(1 + exp(-|z|))``."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        e = _exp_minus_magnitude(builder, values[0])
        # log(1 + e) = 2 artanh(u), u = e / (2 + e) <= 1/3; the omitted terms are below 1e-8.
        u = builder.fdiv(e, builder.fadd(e, _constant(2.0)))
        series = _horner(builder, builder.fmul(u, u), [2.0 / (2 * k + 1) for k in range(7)])
        above = builder.fcmp_ordered(">", values[0], _constant(0.0))
        positive = builder.select(above, values[0], _constant(0.0))
        return builder.fadd(positive, builder.fmul(u, series))

    return _lanes(_lanes), generate


@_operation
def add_sums(
    typing_context: Any, array: Any, index: Any, a: Any, b: Any, c: Any, d: Any, x: Any
) -> Any:
    """Add the sums over lanes of ``a x``, ``b x``, ``c x``, ``d x`` to four array elements."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        address = _address(context, builder, signature.args[0], *values[:2])
        rows = [builder.fmul(values[6], row, flags=FAST) for row in values[2:6]]

        def pick(x: Any, y: Any, lanes: list[int]) -> Any:
            mask = ir.Constant(ir.VectorType(_INT32, len(lanes)), lanes)
            return builder.shuffle_vector(x, y, mask)

        def halves(x: Any, n: int) -> Any:
            return builder.fadd(
                pick(x, x, list(range(n // 2))), pick(x, x, list(range(n // 2, n))), flags=FAST
            )

        def interleave(x: Any, y: Any) -> Any:
            # Within each group of four lanes: x0 + x1, x2 + x3, y0 + y1, y2 + y3.
            n = x.type.count
            even = [k + j + s for k in range(0, n, 4) for s in (0, n) for j in (0, 2)]
            odd = [k + 1 for k in even]
            return builder.fadd(pick(x, y, even), pick(x, y, odd), flags=FAST)

        rows = [halves(row, LANES) for row in rows]
        total = interleave(interleave(rows[0], rows[1]), interleave(rows[2], rows[3]))
        total = halves(total, LANES // 2)
        place = builder.bitcast(address, ir.VectorType(_SCALAR, QUAD).as_pointer())
        total = builder.fadd(builder.load(place, align=4), total, flags=FAST)
        builder.store(total, place, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, _lanes, _lanes, _lanes, _lanes, _lanes), generate
