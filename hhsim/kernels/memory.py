"""Copies of arrays without allocation, and requests for memory before it is needed, on which no result depends."""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numpy.typing import NDArray

from hhsim.kernels.jit import jit, jit_inline, lowered


@jit
def copy_values(source: NDArray[Any], target_out: NDArray[Any]) -> None:
    """Copy `source` to an array of the same shape in other memory."""
    for index in np.ndindex(source.shape):
        target_out[index] = source[index]


CACHE_LINE = 64
"""Bytes that are fetched together."""
READ, KEEP, DATA = 0, 3, 1
"""Arguments of `llvm.prefetch`: for reading, kept in all caches, data."""


def _prefetch_line(typing: Any, array: Any, index: Any, offset: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        rows = context.make_array(signature.args[0])(context, builder, arguments[0])
        stride = cgutils.unpack_tuple(builder, rows.strides)[0]
        offset = builder.add(builder.mul(arguments[1], stride), arguments[2])
        byte = ir.IntType(8).as_pointer()
        place = builder.gep(builder.bitcast(rows.data, byte), [offset])
        number = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), (byte, number, number, number))
        function = builder.module.declare_intrinsic("llvm.prefetch", (byte,), kind)
        builder.call(function, (place, number(READ), number(KEEP), number(DATA)))
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64), generate


@lowered(_prefetch_line)
def _prefetch(array: NDArray[Any], index: int, offset: int) -> None:
    pass


@jit_inline
def prefetch(array: NDArray[Any], index: int, size: int) -> None:
    """Request the first `size` bytes of array[index], to within a cache line."""
    for offset in range(0, size, CACHE_LINE):
        _prefetch(array, index, offset)
