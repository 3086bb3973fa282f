"""Clocks that a kernel can read, so that a block of ticks in one compiled call is timed tick by tick, and waits."""

import sys
import time
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils

from hhsim.kernels.jit import as_int64, jit, lowered

CLOCK_MONOTONIC: int = getattr(time, "CLOCK_MONOTONIC", 0)
CLOCK_THREAD_CPU: int = getattr(time, "CLOCK_THREAD_CPUTIME_ID", 0)
"""Numbers of the system's clocks. Windows has one that is fine enough: there CPU times are wall times."""
_COUNTS_TO_NS = 100
"""Period of Windows' performance counter [ns]: it counts at 10 MHz since Windows 10."""
_TIMER_ABSTIME = 1
_POLLIN = 1
_SECOND = 1_000_000_000


def call_c(builder: Any, name: str, result: Any, *arguments: Any) -> Any:
    """Insert a call of a C function whose parameters have the types of the arguments."""
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


def _clock_gettime(typing: Any, clock: Any) -> Any:
    def count(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        integer = ir.IntType(64)
        now = cgutils.alloca_once(builder, integer)
        call_c(builder, "QueryPerformanceCounter", ir.IntType(32), now)
        return builder.mul(builder.load(now), integer(_COUNTS_TO_NS))

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        integer, number = ir.IntType(64), ir.IntType(32)
        now = cgutils.alloca_once(builder, ir.ArrayType(integer, 2))
        call_c(builder, "clock_gettime", number, builder.trunc(arguments[0], number), now)
        seconds, rest = (builder.load(cgutils.gep_inbounds(builder, now, 0, i)) for i in range(2))
        return builder.add(builder.mul(seconds, integer(_SECOND)), rest)

    return types.int64(types.int64), count if sys.platform == "win32" else generate


def _clock_nanosleep(typing: Any, time_ns: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        integer, number = ir.IntType(64), ir.IntType(32)
        until = _timespec(builder, arguments[0])
        clock, flags = number(CLOCK_MONOTONIC), number(_TIMER_ABSTIME)
        answer = call_c(builder, "clock_nanosleep", number, clock, flags, until, until.type(None))
        return builder.sext(answer, integer)

    return types.int64(types.int64), generate


def _timespec(builder: Any, time_ns: Any) -> Any:
    """Make a struct timespec on the stack."""
    integer = ir.IntType(64)
    spec = cgutils.alloca_once(builder, ir.ArrayType(integer, 2))
    for i, part in enumerate((builder.sdiv, builder.srem)):
        builder.store(part(time_ns, integer(_SECOND)), cgutils.gep_inbounds(builder, spec, 0, i))
    return spec


def _ppoll(typing: Any, descriptor: Any, timeout_ns: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        integer, number, short = ir.IntType(64), ir.IntType(32), ir.IntType(16)
        # struct pollfd: descriptor, requested events, returned events.
        request = cgutils.alloca_once(builder, ir.LiteralStructType((number, short, short)))
        for i, value in enumerate((builder.trunc(arguments[0], number), short(_POLLIN), short(0))):
            builder.store(value, cgutils.gep_inbounds(builder, request, 0, i))
        timeout = _timespec(builder, arguments[1])
        no_signals = ir.IntType(8).as_pointer()(None)
        answer = call_c(builder, "ppoll", number, request, integer(1), timeout, no_signals)
        return builder.sext(answer, integer)

    return types.int64(types.int64, types.int64), generate


def _on_event(builder: Any, name: str, descriptor: Any) -> Any:
    """Read the counter of an eventfd, or write 1 to it."""
    word = ir.IntType(64)
    count = cgutils.alloca_once_value(builder, word(1))
    return call_c(builder, name, word, builder.trunc(descriptor, ir.IntType(32)), count, word(8))


def _read_event(typing: Any, descriptor: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _on_event(builder, "read", arguments[0])

    return types.int64(types.int64), generate


def _write_event(typing: Any, descriptor: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _on_event(builder, "write", arguments[0])

    return types.int64(types.int64), generate


# A ctypes function pointer makes a kernel uncacheable; an external symbol does not.


@lowered(_clock_gettime)
def _read(clock: int) -> int:
    if sys.platform == "win32":
        return time.perf_counter_ns()
    return time.clock_gettime_ns(clock)


@lowered(_clock_nanosleep)
def _sleep(time_ns: int) -> int:
    time.sleep(max(0.0, 1e-9 * (time_ns - time.monotonic_ns())))
    return 0


@lowered(_ppoll)
def _poll(descriptor: int, timeout_ns: int) -> int:
    time.sleep(1e-9 * timeout_ns)
    return 0


@lowered(_read_event)
def _clear(descriptor: int) -> int:
    return -1


@lowered(_write_event)
def send_event(descriptor: int) -> int:
    """Wake who waits for an eventfd; return the system's answer."""
    return 0


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


@jit
def sleep_until(time_ns: int) -> int:
    """Sleep until CLOCK_MONOTONIC is `time_ns` or a signal arrives; return 0, or the system's error."""
    return _sleep(time_ns)


@jit
def await_event(descriptor: int, time_ns: int) -> int:
    """Sleep until an event arrives, CLOCK_MONOTONIC is `time_ns`, or a signal arrives; a past time only polls.

    The descriptor is a non-blocking eventfd. Returns 1 if the event arrived, which is then taken, else 0 or the
    system's -1.
    """
    arrived = _poll(descriptor, max(0, time_ns - monotonic_ns()))
    if arrived > 0:
        _clear(descriptor)
    return arrived
