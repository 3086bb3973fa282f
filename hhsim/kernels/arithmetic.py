"""Fused products and sums in vector lanes, each rounded as the source says: the same bits on every machine.

A compiler that may fuse or reorder chooses by the processor. `fused` rounds once everywhere. In `dot`, term i is added
in lane i modulo `LANES`, and the lanes are added by halves at the end.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hhsim.kernels.jit import JIT_ENABLED, Array

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
            halves = (
                ir.Constant(ir.VectorType(ir.IntType(32), width), list(range(first, first + width)))
                for first in (0, width)
            )
            lanes = builder.fadd(*(builder.shuffle_vector(lanes, lanes, half) for half in halves))
        return builder.extract_element(lanes, ir.Constant(ir.IntType(32), 0))

    return types.float64(first, second, types.int64), generate


if JIT_ENABLED:
    fused = cast(Callable[[float, float, float], float], intrinsic(_fused))
    dot = cast(Callable[[Array, Array, int], float], intrinsic(_dot))
else:

    def fused(first: float, second: float, third: float) -> float:
        """Return first * second + third, rounded once."""
        if not all(map(math.isfinite, (first, second, third))):
            return first * second + third
        exact = Fraction(first) * Fraction(second) + Fraction(third)
        return float(exact) if exact else first * second + third

    def dot(first: Array, second: Array, chunks: int) -> float:
        """Return the sum of products of the first `chunks` times `LANES` numbers of two contiguous vectors."""
        lanes = [0.0] * LANES
        for i in range(chunks * LANES):
            lanes[i % LANES] = fused(first[i], second[i], lanes[i % LANES])
        while len(lanes) > 1:
            half = len(lanes) // 2
            lanes = [lanes[i] + lanes[i + half] for i in range(half)]
        return lanes[0]
