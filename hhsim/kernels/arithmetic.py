"""Fused products and sums in vector lanes, each rounded as the source says: the same bits on every machine.

A compiler that may fuse or reorder chooses by the processor. `fused` rounds once everywhere. In `dot`, term i is added
in lane i modulo `LANES`, and the lanes are added by halves at the end.
"""

import math
from fractions import Fraction
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from hhsim.kernels.jit import Array, jit_inline, lowered

LANES = 8
"""Numbers in one vector instruction, or in two; vectors are padded with zeros to whole multiples."""


def _fused(typing: Any, first: Any, second: Any, third: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.fma(*arguments)

    return types.float64(types.float64, types.float64, types.float64), generate


def _dot(typing: Any, first: Any, second: Any, chunks: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector = ir.VectorType(ir.DoubleType(), LANES)
        data = [
            builder.bitcast(context.make_array(kind)(context, builder, value).data, vector.as_pointer())
            for kind, value in zip(signature.args[:2], arguments[:2])
        ]
        kind = ir.FunctionType(vector, (vector, vector, vector))
        fma = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{LANES}f64")
        total = cgutils.alloca_once_value(builder, ir.Constant(vector, [0.0] * LANES))
        with cgutils.for_range(builder, arguments[2]) as loop:
            left, right = (builder.load(builder.gep(place, [loop.index]), align=8) for place in data)
            builder.store(builder.call(fma, (left, right, builder.load(total))), total)
        lanes, width = builder.load(total), LANES
        while width > 1:
            width //= 2
            lanes = builder.fadd(*_halves(builder, lanes, width))
        return builder.extract_element(lanes, ir.Constant(ir.IntType(32), 0))

    return types.float64(first, second, types.int64), generate


def _least(typing: Any, values: Any, first: Any, chunks: Any, above: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector = ir.VectorType(ir.DoubleType(), LANES)
        start = builder.gep(context.make_array(values)(context, builder, arguments[0]).data, [arguments[1]])
        place, floor = builder.bitcast(start, vector.as_pointer()), ir.Constant(vector, ir.Undefined)
        for lane in range(LANES):
            floor = builder.insert_element(floor, arguments[3], ir.Constant(ir.IntType(32), lane))
        least = cgutils.alloca_once_value(builder, ir.Constant(vector, [math.inf] * LANES))
        with cgutils.for_range(builder, arguments[2]) as loop:
            value, before = builder.load(builder.gep(place, [loop.index]), align=8), builder.load(least)
            less = builder.fcmp_ordered("<", value, before)
            counts = builder.and_(less, builder.fcmp_ordered(">", value, floor))
            builder.store(builder.select(counts, value, before), least)
        lanes, width = builder.load(least), LANES
        while width > 1:
            width //= 2
            low, high = _halves(builder, lanes, width)
            lanes = builder.select(builder.fcmp_ordered("<", low, high), low, high)
        return builder.extract_element(lanes, ir.Constant(ir.IntType(32), 0))

    return types.float64(values, types.int64, types.int64, types.float64), generate


def _halves(builder: Any, lanes: Any, width: int) -> list[Any]:
    kind = ir.VectorType(ir.IntType(32), width)
    halves = (ir.Constant(kind, list(range(first, first + width))) for first in (0, width))
    return [builder.shuffle_vector(lanes, lanes, half) for half in halves]


@lowered(_fused)
def fused(first: float, second: float, third: float) -> float:
    """Return first * second + third, rounded once."""
    if not all(map(math.isfinite, (first, second, third))):
        return first * second + third
    exact = Fraction(first) * Fraction(second) + Fraction(third)
    return float(exact) if exact else first * second + third


@lowered(_dot)
def dot(first: Array, second: Array, chunks: int) -> float:
    """Return the sum of products of the first `chunks` times `LANES` numbers of two contiguous vectors."""
    lanes = [0.0] * LANES
    for i in range(chunks * LANES):
        lanes[i % LANES] = fused(first[i], second[i], lanes[i % LANES])
    while len(lanes) > 1:
        half = len(lanes) // 2
        lanes = [lanes[i] + lanes[i + half] for i in range(half)]
    return lanes[0]


@lowered(_least)
def least_of_chunks(values: Array, first: int, chunks: int, above: float) -> float:
    """Return the least of `chunks` times `LANES` numbers from `first` on that are greater than `above`, or ∞."""
    part = values[first : first + LANES * chunks]
    return float(min(part[part > above], default=math.inf))


@jit_inline
def least_above(values: Array, start: int, stop: int, above: float) -> float:
    """Compute the least of values[start:stop] that is greater than `above`; infinite if there is none."""
    chunks = (stop - start) // LANES
    least = least_of_chunks(values, start, chunks, above)
    for i in range(start + LANES * chunks, stop):
        least = values[i] if (values[i] < least) & (values[i] > above) else least
    return least


@jit_inline
def product(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Compute the scalar product of two vectors, rounded once a term."""
    return fused(az, bz, fused(ay, by, ax * bx))
