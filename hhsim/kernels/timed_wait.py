"""Waits inside compiled code, without the interpreter."""

import time
from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from hhsim.kernels.clock import CLOCK_MONOTONIC, monotonic_ns
from hhsim.kernels.jit import JIT_ENABLED, jit

_TIMER_ABSTIME = 1
_POLLIN = 1
_SECOND = 1_000_000_000


def _clock_nanosleep(typing: Any, time_ns: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        integer, number = ir.IntType(64), ir.IntType(32)
        until = _timespec(builder, arguments[0])
        kind = ir.FunctionType(number, (number, number, until.type, until.type))
        function = cgutils.get_or_insert_function(builder.module, kind, "clock_nanosleep")
        answer = builder.call(function, (number(CLOCK_MONOTONIC), number(_TIMER_ABSTIME), until, until.type(None)))
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
        signals = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(number, (request.type, integer, timeout.type, signals))
        function = cgutils.get_or_insert_function(builder.module, kind, "ppoll")
        answer = builder.call(function, (request, integer(1), timeout, signals(None)))
        return builder.sext(answer, integer)

    return types.int64(types.int64, types.int64), generate


def _read_event(typing: Any, descriptor: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, number = ir.IntType(64), ir.IntType(32)
        count = cgutils.alloca_once(builder, word)
        kind = ir.FunctionType(word, (number, count.type, word))
        function = cgutils.get_or_insert_function(builder.module, kind, "read")
        return builder.call(function, (builder.trunc(arguments[0], number), count, word(8)))

    return types.int64(types.int64), generate


if JIT_ENABLED:
    # External symbols, as in `clock`: a kernel with a function pointer in it cannot be cached.
    _sleep = cast(Callable[[int], int], intrinsic(_clock_nanosleep))
    _poll = cast(Callable[[int, int], int], intrinsic(_ppoll))
    _clear = cast(Callable[[int], int], intrinsic(_read_event))

else:

    def _sleep(time_ns: int) -> int:
        time.sleep(max(0.0, 1e-9 * (time_ns - time.monotonic_ns())))
        return 0

    def _poll(descriptor: int, timeout_ns: int) -> int:
        time.sleep(1e-9 * timeout_ns)
        return 0

    def _clear(descriptor: int) -> int:
        return -1


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
