"""Clocks that a kernel can read, so that a block of ticks in one compiled call is timed tick by tick."""

import time
from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hhsim.kernels.jit import JIT_ENABLED, as_int64, jit

CLOCK_MONOTONIC = 1
CLOCK_THREAD_CPU = 3


def _clock_gettime(typing: Any, clock: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        integer = ir.IntType(64)
        now = cgutils.alloca_once(builder, ir.ArrayType(integer, 2))
        kind = ir.FunctionType(ir.IntType(32), (ir.IntType(32), now.type))
        function = cgutils.get_or_insert_function(builder.module, kind, "clock_gettime")
        builder.call(function, (builder.trunc(arguments[0], ir.IntType(32)), now))
        seconds, rest = (builder.load(cgutils.gep_inbounds(builder, now, 0, i)) for i in range(2))
        return builder.add(builder.mul(seconds, integer(1_000_000_000)), rest)

    return types.int64(types.int64), generate


if JIT_ENABLED:
    # A ctypes function pointer makes a kernel uncacheable; an external symbol does not.
    _read = cast(Callable[[int], int], intrinsic(_clock_gettime))

else:

    def _read(clock: int) -> int:
        return time.clock_gettime_ns(clock)


@jit
def monotonic_ns() -> int:
    """Return the monotonic wall clock [ns]."""
    return _read(as_int64(CLOCK_MONOTONIC))


@jit
def cpu_ns(clock: int) -> int:
    """Return CPU time [ns] on a thread's clock, a number of `time.pthread_getcpuclockid`."""
    return _read(clock)


@jit
def thread_cpu_ns() -> int:
    """Return the CPU time of the calling thread [ns]."""
    return _read(as_int64(CLOCK_THREAD_CPU))
