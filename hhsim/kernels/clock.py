"""Clocks that a kernel can read, so that a block of ticks in one compiled call is timed tick by tick, and waits."""

import time
from typing import Any

from llvmlite import ir
from numba.core import cgutils

from hhsim.kernels.jit import as_int64, jit, lowered

CLOCK_MONOTONIC: int = time.CLOCK_MONOTONIC
CLOCK_THREAD_CPU: int = time.CLOCK_THREAD_CPUTIME_ID
"""Numbers of the system's clocks."""
_TIMER_ABSTIME = 1
_POLLIN = 1
_SECOND = 1_000_000_000
_WORD, _INT = ir.IntType(64), ir.IntType(32)


def call_c(builder: Any, name: str, result: Any, *arguments: Any) -> Any:
    """Insert a call of a C function whose parameters have the types of the arguments."""
    # A ctypes function pointer makes a kernel uncacheable; an external symbol does not.
    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)


def _timespec(builder: Any, time_ns: Any) -> Any:
    """Make a struct timespec on the stack."""
    spec = cgutils.alloca_once(builder, ir.ArrayType(_WORD, 2))
    for i, part in enumerate((builder.sdiv, builder.srem)):
        builder.store(part(time_ns, _WORD(_SECOND)), cgutils.gep_inbounds(builder, spec, 0, i))
    return spec


@lowered(int)
def cpu_ns(builder: Any, clock: Any) -> Any:
    """Return CPU time [ns] on a thread's clock, a number of `time.pthread_getcpuclockid`, or any clock's time."""
    now = cgutils.alloca_once(builder, ir.ArrayType(_WORD, 2))
    call_c(builder, "clock_gettime", _INT, builder.trunc(clock, _INT), now)
    seconds, rest = (builder.load(cgutils.gep_inbounds(builder, now, 0, i)) for i in range(2))
    return builder.add(builder.mul(seconds, _WORD(_SECOND)), rest)


@lowered(int)
def sleep_until(builder: Any, time_ns: Any) -> Any:
    """Sleep until CLOCK_MONOTONIC is `time_ns` or a signal arrives; return 0, or the system's error."""
    until = _timespec(builder, time_ns)
    clock, flags = _INT(CLOCK_MONOTONIC), _INT(_TIMER_ABSTIME)
    return builder.sext(call_c(builder, "clock_nanosleep", _INT, clock, flags, until, until.type(None)), _WORD)


@lowered(int)
def _poll(builder: Any, descriptor: Any, timeout_ns: Any) -> Any:
    """Wait for something to read; return 1 if it came, 0 if not, or the system's -1."""
    # struct pollfd: descriptor, requested events, returned events.
    short = ir.IntType(16)
    request = cgutils.alloca_once(builder, ir.LiteralStructType((_INT, short, short)))
    for i, value in enumerate((builder.trunc(descriptor, _INT), short(_POLLIN), short(0))):
        builder.store(value, cgutils.gep_inbounds(builder, request, 0, i))
    no_signals = ir.IntType(8).as_pointer()(None)
    answer = call_c(builder, "ppoll", _INT, request, _WORD(1), _timespec(builder, timeout_ns), no_signals)
    return builder.sext(answer, _WORD)


def _on_event(builder: Any, name: str, descriptor: Any) -> Any:
    """Read the counter of an eventfd, or write 1 to it."""
    count = cgutils.alloca_once_value(builder, _WORD(1))
    return call_c(builder, name, _WORD, builder.trunc(descriptor, _INT), count, _WORD(8))


@lowered(int)
def _take_event(builder: Any, descriptor: Any) -> Any:
    """Set an eventfd to 0; return the system's answer."""
    return _on_event(builder, "read", descriptor)


@lowered(int)
def send_event(builder: Any, descriptor: Any) -> Any:
    """Wake who waits for an eventfd; return the system's answer."""
    return _on_event(builder, "write", descriptor)


@jit
def monotonic_ns() -> int:
    """Return the monotonic wall clock [ns]."""
    return cpu_ns(as_int64(CLOCK_MONOTONIC))


@jit
def thread_cpu_ns() -> int:
    """Return the CPU time of the calling thread [ns]."""
    return cpu_ns(as_int64(CLOCK_THREAD_CPU))


@jit
def await_event(descriptor: int, time_ns: int) -> int:
    """Sleep until an event arrives, CLOCK_MONOTONIC is `time_ns`, or a signal arrives; a past time only polls.

    The descriptor is a non-blocking eventfd. Returns 1 if the event arrived, which is then taken, else 0 or the
    system's -1.
    """
    arrived = _poll(descriptor, max(0, time_ns - monotonic_ns()))
    if arrived > 0:
        _take_event(descriptor)
    return arrived
