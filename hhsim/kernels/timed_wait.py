"""Sleeping inside compiled code, so that no interpreter takes part in a wait."""

import time
from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hhsim.kernels.clock import CLOCK_MONOTONIC
from hhsim.kernels.jit import JIT_ENABLED, jit

_TIMER_ABSTIME = 1


def _clock_nanosleep(typing: Any, time_ns: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        integer, number = ir.IntType(64), ir.IntType(32)
        until = cgutils.alloca_once(builder, ir.ArrayType(integer, 2))
        second = integer(1_000_000_000)
        parts = (builder.sdiv(arguments[0], second), builder.srem(arguments[0], second))
        for i, part in enumerate(parts):
            builder.store(part, cgutils.gep_inbounds(builder, until, 0, i))
        kind = ir.FunctionType(number, (number, number, until.type, until.type))
        function = cgutils.get_or_insert_function(builder.module, kind, "clock_nanosleep")
        answer = builder.call(function, (number(CLOCK_MONOTONIC), number(_TIMER_ABSTIME), until, until.type(None)))
        return builder.sext(answer, integer)

    return types.int64(types.int64), generate


if JIT_ENABLED:
    # An external symbol, as in `clock`: a kernel with a function pointer in it could not be kept.
    _sleep = cast(Callable[[int], int], intrinsic(_clock_nanosleep))

else:

    def _sleep(time_ns: int) -> int:
        time.sleep(max(0.0, 1e-9 * (time_ns - time.monotonic_ns())))
        return 0


@jit
def sleep_until(time_ns: int) -> int:
    """Sleep until CLOCK_MONOTONIC is `time_ns`, or until a signal came; 0, or the system's error."""
    return _sleep(time_ns)
