"""Atomic operations on elements of aligned int64 arrays, as numpy's own are.

Values written before `store_release` or `fetch_add` are seen by a thread that has read the new value by `load_acquire`,
`fetch_add` or `compare_exchange`. With the compiler disabled these are plain reads and writes, for one thread.
"""

import platform
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from hhsim.kernels.clock import call_c
from hhsim.kernels.jit import Indices, jit_inline, lowered

WORD_BYTES = 8
PAUSES = {"x86_64": "llvm.x86.sse2.pause", "AMD64": "llvm.x86.sse2.pause"}
"""Instruction for a waiting loop, by machine; there is none on others."""


def _pointer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    array_type = signature.args[0]
    array = context.make_array(array_type)(context, builder, arguments[0])
    return cgutils.get_item_pointer(context, builder, array_type, array, [arguments[1]], wraparound=False)


def _load_acquire(typing: Any, array: Any, index: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load_atomic(_pointer(context, builder, signature, arguments), "acquire", WORD_BYTES)

    return types.int64(array, types.int64), generate


def _store_release(typing: Any, array: Any, index: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = _pointer(context, builder, signature, arguments)
        builder.store_atomic(arguments[2], pointer, "release", WORD_BYTES)
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64), generate


def _fetch_add(typing: Any, array: Any, index: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.atomic_rmw("add", _pointer(context, builder, signature, arguments), arguments[2], "acq_rel")

    return types.int64(array, types.int64, types.int64), generate


def _compare_exchange(typing: Any, array: Any, index: Any, expected: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = _pointer(context, builder, signature, arguments)
        outcome = builder.cmpxchg(pointer, arguments[2], arguments[3], "acq_rel", "acquire")
        return builder.extract_value(outcome, 1)

    return types.boolean(array, types.int64, types.int64, types.int64), generate


def _pause(typing: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        name = PAUSES.get(platform.machine())
        if name is not None:
            call_c(builder, name, ir.VoidType())
        return context.get_dummy_value()

    return types.void(), generate


def _sched_yield(typing: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return call_c(builder, "sched_yield", ir.IntType(32))

    return types.int32(), generate


@lowered(_load_acquire)
def _load(array: Indices, index: int) -> int:
    return int(array[index])


@lowered(_store_release)
def _store(array: Indices, index: int, value: int) -> None:
    array[index] = value


@lowered(_fetch_add)
def fetch_add(array: Indices, index: int, value: int) -> int:
    """Add to array[index]; return the value before."""
    before = int(array[index])
    array[index] = before + value
    return before


@lowered(_compare_exchange)
def compare_exchange(array: Indices, index: int, expected: int, value: int) -> bool:
    """Set array[index] if it is `expected`; return True if it was."""
    if array[index] != expected:
        return False
    array[index] = value
    return True


@lowered(_pause)
def pause() -> None:
    """Execute the processor's instruction for a waiting loop."""


@lowered(_sched_yield)
def yield_processor() -> int:
    """Yield the processor to another ready thread; return 0."""
    return 0


# Python, which can call no intrinsic, calls these two.


@jit_inline
def load_acquire(array: Indices, index: int) -> int:
    """Return array[index]; all that was written before its store is seen."""
    return _load(array, index)


@jit_inline
def store_release(array: Indices, index: int, value: int) -> None:
    """Set array[index]; all that was written before is seen by its readers."""
    _store(array, index, value)
