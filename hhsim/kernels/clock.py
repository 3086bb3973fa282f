"""Clocks that a kernel can read.

With them whole blocks of ticks run inside one compiled call and are still timed tick by tick.
"""

import time

import numpy as np
from numba import types

from hhsim.kernels.jit import JIT_ENABLED, as_int64, jit

CLOCK_MONOTONIC = 1
CLOCK_THREAD_CPU = 3

if JIT_ENABLED:
    # ctypes function pointers make a kernel uncacheable; an external symbol does not.
    _clock_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.CPointer(types.int64)))

    @jit
    def _read(clock: int) -> int:
        now = np.empty(2, np.int64)
        _clock_gettime(clock, now.ctypes)
        return now[0] * 1_000_000_000 + now[1]

else:

    def _read(clock: int) -> int:
        return time.clock_gettime_ns(clock)


@jit
def monotonic_ns() -> int:
    """Wall clock [ns], monotonic."""
    return _read(as_int64(CLOCK_MONOTONIC))


@jit
def cpu_ns(clock: int) -> int:
    """CPU time [ns] on a thread's clock, by the number that `time.pthread_getcpuclockid` gives."""
    return _read(clock)


@jit
def thread_cpu_ns() -> int:
    """CPU time of the calling thread [ns]."""
    return _read(as_int64(CLOCK_THREAD_CPU))
