"""Waiting for deadlines inside compiled code, so that a measurement of wake-ups has no interpreter in it."""

import time
from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from hhsim.kernels.clock import CLOCK_MONOTONIC, monotonic_ns
from hhsim.kernels.jit import JIT_ENABLED, jit

PASSED = -1
"""Stands for a deadline that had passed when the thread woke from the one before."""
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


@jit
def wait_periods(period: int, late_out: NDArray[np.int64]) -> int:
    """Sleep until each of a row of absolute deadlines, the first of them a period from now.

    A deadline that has passed is left out, as a loop leaves out a period that it missed.

    Args:
        period: Between two deadlines [ns].
        late_out: One entry a deadline: how long after it the thread woke [ns], or `PASSED`.

    Returns:
        How many deadlines had passed, those beyond the row too.
    """
    began = monotonic_ns()
    count = late_out.shape[0]
    missed = 0
    i = 0
    while i < count:
        deadline = began + (i + 1) * period
        now = monotonic_ns()
        while now < deadline:
            sleep_until(deadline)
            now = monotonic_ns()
        late_out[i] = now - deadline
        passed = (now - deadline) // period
        for k in range(i + 1, min(i + 1 + passed, count)):
            late_out[k] = PASSED
        missed += passed
        i += 1 + passed
    return missed
