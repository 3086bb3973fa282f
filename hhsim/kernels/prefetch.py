"""Asking the processor for memory before it is needed.

A walk through a hierarchy goes from place to place in memory, and waits at each. What it will look at next is known a
little before, and can be on its way meanwhile. Nothing is read: a place that turns out not to be needed costs a line of
the cache, and no result depends on it.

With the compiler disabled nothing happens.
"""

from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from hhsim.kernels.jit import JIT_ENABLED, jit_inline

CACHE_LINE = 64
"""Bytes that come at once."""
READ, KEEP, DATA = 0, 3, 1
"""What `llvm.prefetch` is told: that it is read, that it stays in all caches, that it is no code."""


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


if JIT_ENABLED:
    _ask = cast(Callable[[NDArray[Any], int, int], None], intrinsic(_prefetch_line))

else:

    def _ask(array: NDArray[Any], index: int, offset: int) -> None:
        pass


@jit_inline
def prefetch(array: NDArray[Any], index: int, size: int) -> None:
    """Ask for the first `size` bytes of array[index], to within a cache line."""
    for offset in range(0, size, CACHE_LINE):
        _ask(array, index, offset)
