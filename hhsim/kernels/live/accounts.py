"""Who took the time of a period that was missed, from what the system and the loop's own clock say of it."""

from collections.abc import Callable
from typing import Any, cast

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from hhsim.kernels.jit import JIT_ENABLED, Record, jit

Bytes = NDArray[np.uint8]

COMPUTED, WOKEN_LATE, HOST, DEVICE = 1, 2, 3, 4
"""The causes of `hhsim.result.miss_cause.MissCause`, whose test compares them."""
CAUSES = 4
UNKNOWN = -1
LONG_STALL_NS = 1_000_000
"""What the host has taken is read in a tick after a stall of so long [ns], and else by another thread.

The reading takes 10 µs warm, and 70 to 130 µs after 32 ms or a stall: a period at 10 kHz, and a miss of our own.
"""
RUN_DELAY_COLUMN = 1
"""Of schedstat."""
STEAL_COLUMN = 8
"""Of a processor's line in /proc/stat, its name being column 0 (proc(5))."""

MISSES = np.dtype(
    [
        ("steal_read", np.int64),
        ("woke_ns", np.int64, (2,)),
        ("late_ns", np.int64, (2,)),
        ("cpu_ns", np.int64, (2,)),
        ("delay_ns", np.int64, (2,)),
        ("steal_ns", np.int64),
        ("taken", np.int64, (5,)),
        ("cause", np.int64),
    ],
    align=True,
)
"""What is kept to say of a missed period who took it; of pairs, the first is of the last tick that was slept for,
the second of the one before it.

| field | meaning |
|---|---|
| steal_read | 1: what the host has taken can be read in a tick |
| woke_ns, late_ns | when the loop woke, and how late |
| cpu_ns, delay_ns | CPU time and run delay of its thread by then; -1 where they are not known |
| steal_ns | what the host had taken when that was read last, by this thread or the one that tells |
| taken, cause | of the periods missed before this tick: `hhsim.result.miss_cause.TimeTaken`, and who took most |
"""


def _pread(typing: Any, descriptor: Any, text: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word, number = ir.IntType(64), ir.IntType(32)
        array = context.make_array(signature.args[1])(context, builder, arguments[1])
        pointer = builder.bitcast(array.data, ir.IntType(8).as_pointer())
        kind = ir.FunctionType(word, (number, pointer.type, word, word))
        function = cgutils.get_or_insert_function(builder.module, kind, "pread")
        return builder.call(function, (builder.trunc(arguments[0], number), pointer, array.nitems, word(0)))

    return types.int64(types.int64, text), generate


if JIT_ENABLED:
    _read_bytes = cast(Callable[[int, Bytes], int], intrinsic(_pread))

else:

    def _read_bytes(descriptor: int, text: Bytes) -> int:
        return UNKNOWN


@jit
def _number(text: Bytes, size: int, at: int, column: int) -> int:
    """The number in a column of the line that begins at `at`, UNKNOWN where there is none."""
    inside = False
    seen = -1
    value = UNKNOWN
    for i in range(at, size):
        letter = int(text[i])
        if letter == 10:
            break
        if letter == 32:
            inside = False
            continue
        if not inside:
            inside = True
            seen += 1
        if seen > column:
            break
        if seen == column:
            if letter < 48 or letter > 57:
                return UNKNOWN
            value = 10 * max(value, 0) + letter - 48
    return value


@jit
def read_run_delay(descriptor: int, text: Bytes) -> int:
    """How long a thread could have run and was not let [ns], from its schedstat; UNKNOWN where it cannot be read.

    Args:
        descriptor: Of the open file, -1 for none.
        text: Room for a line.
    """
    return _number(text, _read_bytes(descriptor, text), 0, RUN_DELAY_COLUMN)


@jit
def read_steal(descriptor: int, text: Bytes, allowed: NDArray[np.bool_], step: int) -> int:
    """How long the host had some processors [ns], from /proc/stat; UNKNOWN where it cannot be read.

    Args:
        descriptor: Of the open file, -1 for none.
        text: Room for the lines of all processors, which come first.
        allowed: Which processors count, by their numbers.
        step: What the system counts in [ns].
    """
    size = _read_bytes(descriptor, text)
    total = UNKNOWN
    at = 0
    while at + 3 < size and text[at] == 99 and text[at + 1] == 112 and text[at + 2] == 117:
        number = 0
        i = at + 3
        while i < size and text[i] >= 48 and text[i] <= 57:
            number = 10 * number + int(text[i]) - 48
            i += 1
        if i > at + 3 and number < allowed.shape[0] and allowed[number]:
            steal = _number(text, size, at, STEAL_COLUMN)
            if steal >= 0:
                total = max(total, 0) + steal * step
        while i < size and text[i] != 10:
            i += 1
        at = i + 1
    return total


@jit
def account_waking(misses: Record, woke: int, wakeup: int, cpu: int, delay: int) -> None:
    """A tick that was slept for begins: what was counted until now is that of the one before.

    One that begins at once belongs to the one before: together they had two periods.

    Args:
        misses: Of `MISSES`.
        woke: When the loop woke [ns].
        wakeup: How long after the deadline of the period that it is in [ns].
        cpu, delay: CPU time and run delay of its thread [ns], -1 where they are not known.
    """
    misses.woke_ns[1] = misses.woke_ns[0]
    misses.late_ns[1] = misses.late_ns[0]
    misses.cpu_ns[1] = misses.cpu_ns[0]
    misses.delay_ns[1] = misses.delay_ns[0]
    misses.woke_ns[0] = woke
    misses.late_ns[0] = wakeup
    misses.cpu_ns[0] = cpu
    misses.delay_ns[0] = delay


@jit
def account_steal(misses: Record, steal: int) -> None:
    """Keep what the host has taken so far, so that a miss is not charged with what it took long before.

    It only rises, whichever of two threads read it first.
    """
    misses.steal_ns = max(misses.steal_ns, steal)


@jit
def _risen(before: int, after: int) -> int:
    return max(0, after - before) if before >= 0 and after >= 0 else 0


@jit
def cause_of(computed: int, kept: int, run_delay: int, steal: int, device: int) -> int:
    """The cause that took most, of the times of a `TimeTaken` [ns], which says how they are set off."""
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
    """Say where the time since the deadline of the tick before that was slept for went, where this one missed periods.

    Args:
        misses: Of `MISSES`.
        asked: When the work of the ticks since then was done [ns].
        late: How late this tick woke, after the deadline that was slept for [ns].

    Returns:
        Whether it was a long stall: `name_miss` then wants to know what the host has taken.
    """
    worked = asked - misses.woke_ns[1]
    # What is charged to a thread that sleeps, such as interrupts, is nothing that it computed.
    computed = min(_risen(misses.cpu_ns[1], misses.cpu_ns[0]), worked)
    misses.taken[0] = computed
    misses.taken[1] = misses.late_ns[1] + max(0, worked - computed) + late
    misses.taken[2] = _risen(misses.delay_ns[1], misses.delay_ns[0])
    return misses.taken[1] >= LONG_STALL_NS and misses.steal_read == 1


@jit
def name_miss(misses: Record, steal: int) -> None:
    """Name what `measure_miss` has measured.

    Args:
        misses: Of `MISSES`.
        steal: What the host has taken by now [ns], -1 where it was not read.
    """
    misses.taken[3] = _risen(misses.steal_ns, steal)
    misses.taken[4] = 0
    misses.cause = cause_of(misses.taken[0], misses.taken[1], misses.taken[2], misses.taken[3], misses.taken[4])
    account_steal(misses, steal)
