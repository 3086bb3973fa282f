"""Attributes the time of a missed period to its cause, from the system's accounts and the loop's clock."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from hhsim.kernels.clock import call_c
from hhsim.kernels.jit import JIT_ENABLED, Record, jit

Bytes = NDArray[np.uint8]

COMPUTED, WOKEN_LATE, HOST, DEVICE = 1, 2, 3, 4
"""Causes of `hhsim.result.miss_cause.MissCause`, whose test compares them."""
CAUSES = 4
UNKNOWN = -1
LONG_STALL_NS = 1_000_000
"""Stall after which a tick reads the host's steal time itself [ns], in 10 µs warm and 70 to 130 µs cold; else another
thread does."""
RUN_DELAY_COLUMN = 1
"""Column of schedstat."""
STEAL_COLUMN = 8
"""Column of a processor's line in /proc/stat, its name being column 0 (proc(5))."""

MISSES = np.dtype(
    [
        ("steal_read", np.int64),  # 1: a tick may read the steal time
        ("woke_ns", np.int64, (2,)),  # when the loop woke
        ("late_ns", np.int64, (2,)),  # how late it woke
        ("cpu_ns", np.int64, (2,)),  # CPU time of its thread by then, -1 where unknown
        ("delay_ns", np.int64, (2,)),  # run delay of its thread by then, -1 where unknown
        ("steal_ns", np.int64),  # newest reading of the steal time
        ("taken", np.int64, (5,)),  # `hhsim.result.miss_cause.TimeTaken` of the periods missed before this tick
        ("cause", np.int64),  # the largest share of it
    ],
    align=True,
)
"""State for naming the cause of a miss; pairs are of the last tick that was slept for, and of the one before it."""


def _pread(typing: Any, descriptor: Any, text: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = ir.IntType(64)
        array = context.make_array(signature.args[1])(context, builder, arguments[1])
        file = builder.trunc(arguments[0], ir.IntType(32))
        return call_c(builder, "pread", word, file, array.data, array.nitems, word(0))

    return types.int64(types.int64, text), generate


if JIT_ENABLED:
    _read_bytes = cast(Callable[[int, Bytes], int], intrinsic(_pread))

else:

    def _read_bytes(descriptor: int, text: Bytes) -> int:
        return UNKNOWN


@jit
def _number(text: Bytes, size: int, at: int, column: int) -> int:
    """Parse the number in a column of the line that begins at `at`; UNKNOWN where there is none."""
    # Columns end with a blank (32), the line with a newline (10).
    for _ in range(column):
        while at < size and text[at] > 32:
            at += 1
        while at < size and text[at] == 32:
            at += 1
    value = UNKNOWN
    while at < size and text[at] > 32:
        digit = int(text[at]) - 48
        if digit < 0 or digit > 9:
            return UNKNOWN
        value = 10 * max(value, 0) + digit
        at += 1
    return value


@jit
def read_run_delay(descriptor: int, text: Bytes) -> int:
    """Read a thread's run delay [ns] from its open schedstat (-1: none) into a line buffer; UNKNOWN on failure."""
    return _number(text, _read_bytes(descriptor, text), 0, RUN_DELAY_COLUMN)


@jit
def read_steal(descriptor: int, text: Bytes, allowed: NDArray[np.bool_], step: int) -> int:
    """Read the host's steal time [ns] of the `allowed` processors from the open /proc/stat; UNKNOWN on failure.

    The buffer `text` holds the lines of all processors, which come first; `step` is the counter's unit [ns].
    """
    size = _read_bytes(descriptor, text)
    total = UNKNOWN
    at = 0
    while at + 3 < size and text[at] == 99 and text[at + 1] == 112 and text[at + 2] == 117:
        number = _number(text, size, at + 3, 0)
        if 0 <= number < allowed.shape[0] and allowed[number]:
            steal = _number(text, size, at, STEAL_COLUMN)
            if steal >= 0:
                total = max(total, 0) + steal * step
        while at < size and text[at] != 10:
            at += 1
        at += 1
    return total


@jit
def account_waking(misses: Record, woke: int, wakeup: int, cpu: int, delay: int) -> None:
    """Begin a tick that was slept for, with CPU time and run delay of the thread [ns], -1 where unknown.

    The loop `woke` with a delay of `wakeup` [ns]. A tick that begins at once belongs to the tick before.
    """
    misses.woke_ns[1], misses.woke_ns[0] = misses.woke_ns[0], woke
    misses.late_ns[1], misses.late_ns[0] = misses.late_ns[0], wakeup
    misses.cpu_ns[1], misses.cpu_ns[0] = misses.cpu_ns[0], cpu
    misses.delay_ns[1], misses.delay_ns[0] = misses.delay_ns[0], delay


@jit
def account_steal(misses: Record, steal: int) -> None:
    """Keep the newest steal time, whichever of two threads read it, so that a miss is not charged with older steal."""
    misses.steal_ns = max(misses.steal_ns, steal)


@jit
def _risen(before: int, after: int) -> int:
    return max(0, after - before) if before >= 0 and after >= 0 else 0


@jit
def cause_of(computed: int, kept: int, run_delay: int, steal: int, device: int) -> int:
    """Return the cause of the largest share of the times of a `TimeTaken` [ns]."""
    waited = min(kept, run_delay)
    host = min(kept - waited, steal)
    late = min(kept - waited - host, device)
    cause, most = HOST, host
    if late > most:
        cause, most = DEVICE, late
    if computed > most:
        cause, most = COMPUTED, computed
    if kept - host - late > most:
        cause = WOKEN_LATE
    return cause


@jit
def measure_miss(misses: Record, asked: int, late: int) -> bool:
    """Measure where the time since the previous slept-for deadline went, for a tick that missed periods.

    The work since then was done by `asked`, and this tick woke `late` after its deadline [ns]. Returns True for a long
    stall: `name_miss` then needs the steal time.
    """
    worked = asked - misses.woke_ns[1]
    # Time charged to a sleeping thread, such as interrupts, was not computed by it.
    computed = min(_risen(misses.cpu_ns[1], misses.cpu_ns[0]), worked)
    misses.taken[0] = computed
    misses.taken[1] = misses.late_ns[1] + max(0, worked - computed) + late
    misses.taken[2] = _risen(misses.delay_ns[1], misses.delay_ns[0])
    return misses.taken[1] >= LONG_STALL_NS and misses.steal_read == 1


@jit
def name_miss(misses: Record, steal: int) -> None:
    """Set the cause of what `measure_miss` measured, with the steal time by now [ns], -1 where it was not read."""
    misses.taken[3] = _risen(misses.steal_ns, steal)
    misses.taken[4] = 0
    misses.cause = cause_of(misses.taken[0], misses.taken[1], misses.taken[2], misses.taken[3], misses.taken[4])
    account_steal(misses, steal)
