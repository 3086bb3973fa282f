"""Copies of arrays without allocation, and requests for memory before it is needed, on which no result depends."""

from typing import Any

import numpy as np
from llvmlite import ir
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


@lowered(type(None))
def _prefetch(builder: Any, rows: Any, index: Any, offset: Any) -> None:
    """Request the cache line `offset` bytes behind the beginning of a row."""
    byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
    stride = cgutils.unpack_tuple(builder, rows.strides)[0]
    place = builder.gep(builder.bitcast(rows.data, byte), [builder.add(builder.mul(index, stride), offset)])
    kind = ir.FunctionType(ir.VoidType(), (byte, number, number, number))
    function = builder.module.declare_intrinsic("llvm.prefetch", (byte,), kind)
    builder.call(function, (place, number(READ), number(KEEP), number(DATA)))


@jit_inline
def prefetch(array: NDArray[Any], index: int, size: int) -> None:
    """Request the first `size` bytes of array[index], to within a cache line."""
    for offset in range(0, size, CACHE_LINE):
        _prefetch(array, index, offset)
