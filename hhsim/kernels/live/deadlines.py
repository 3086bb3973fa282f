"""Periods of the live loop: deadlines, the phase of samples in them, and what a missed one is due to.

A tick is due at its deadline, or with its input up to `EARLIEST` periods before it. Deadlines do not move with it, so
there is one tick a period; a period in which no tick begins is missed.

A glove whose interval is a whole number of periods has a constant phase in them: deadlines move so that each of its
samples finds a waiting loop. Mean direction and spread are those of directional statistics (Mardia and Jupp,
Directional Statistics, 2000, section 2.3). For other gloves deadlines do not move.

The time of a missed period is attributed to its cause, from the system's accounts and the loop's clock.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numpy.typing import NDArray

from hhsim.kernels.arithmetic import arc_tangent, hypotenuse, sine_cosine
from hhsim.kernels.clock import call_c, monotonic_ns, sleep_until
from hhsim.kernels.jit import Record, as_int64, jit, lowered

PASSED = -1
"""Delay of a deadline that could not be slept for."""
NOTHING = -1
"""Arrival time of an input that has not come."""
EARLIEST = 0.75
"""Longest time before its deadline at which a tick is due [periods]."""

DEADLINES = np.dtype(
    [
        ("period_ns", np.int64),
        ("shift_ns", np.int64),  # by which the present period is longer
        ("tick", np.int64),  # number of the present period, from 0; missed ones leave gaps
        ("deadline_ns", np.int64),  # latest time at which it was to begin
        ("early_ns", np.int64),  # time before the deadline at which it was due, 0 without an input
        ("asked_ns", np.int64),  # when the loop began to wait
        ("woke_ns", np.int64),
        ("wakeup_ns", np.int64),  # delay after the tick was due
        ("late_ns", np.int64),  # delay after the time slept for, with the periods that went by
        ("missed", np.int64),  # periods between the tick before and this one
        ("missed_total", np.int64),
        ("aim_ns", np.int64),  # deadline that is slept for
        ("passed", np.int64),  # periods that had passed before the sleep
        ("at_once", np.int64),  # 1: began without a sleep, as the work before ended in this period
    ],
    align=True,
)
"""State of a loop's periods; times are CLOCK_MONOTONIC [ns]."""


@jit
def begin_periods(deadlines: Record, now: int) -> None:
    """Begin the periods: the first deadline is one period from now [ns]."""
    deadlines.tick = -1
    deadlines.deadline_ns = deadlines.asked_ns = deadlines.woke_ns = now
    deadlines.early_ns = deadlines.wakeup_ns = deadlines.late_ns = deadlines.missed = deadlines.missed_total = 0
    deadlines.aim_ns = now
    deadlines.passed = deadlines.at_once = deadlines.shift_ns = 0


@jit
def next_deadline(deadlines: Record, now: int) -> int:
    """Return the deadline to sleep for [ns].

    The tick of a deadline that passed less than half a period ago begins at once if the tick before was slept for: so
    three ticks never follow without a pause, and a loop that is too slow leaves the processor to others. Any other
    passed deadline is missed.
    """
    aim = deadlines.deadline_ns + deadlines.period_ns + deadlines.shift_ns
    deadlines.asked_ns = now
    deadlines.passed = 0
    past = now - aim
    deadlines.at_once = 1 if deadlines.at_once == 0 and past >= 0 and 2 * past <= deadlines.period_ns else 0
    if past >= 0 and deadlines.at_once == 0:
        deadlines.passed = past // deadlines.period_ns + 1
        aim += deadlines.passed * deadlines.period_ns
    deadlines.aim_ns = aim
    return aim


@jit
def due_time(deadlines: Record, came: int, now: int) -> int:
    """Return when the tick is due [ns]: with its input that `came`, else (`NOTHING`) at its deadline.

    A loop whose work was not done at the earliest due time keeps to its deadline: an early tick follows a pause.
    """
    aim = deadlines.aim_ns
    earliest = aim - int(EARLIEST * float(deadlines.period_ns))
    if came == NOTHING or now >= aim or deadlines.asked_ns > earliest or deadlines.passed > 0:
        return aim
    return min(max(came, earliest), aim)


@jit
def woken(deadlines: Record, now: int, due: int) -> None:
    """Count a wake-up at `now` of a tick that was `due` [ns]; after oversleeping, the present period goes on."""
    deadlines.early_ns = deadlines.aim_ns - due
    late = now - due
    overslept = late // deadlines.period_ns
    missed = deadlines.passed + overslept
    deadlines.tick += 1 + missed
    deadlines.deadline_ns = deadlines.aim_ns + overslept * deadlines.period_ns
    deadlines.woke_ns = now
    deadlines.wakeup_ns = late - overslept * deadlines.period_ns
    deadlines.late_ns = late
    deadlines.missed = missed
    deadlines.missed_total += missed


@jit
def wait_periods(deadlines: Record, late_out: NDArray[np.int64]) -> int:
    """Wait for a row of deadlines, the first a period from now, and return how many were missed.

    Writes the delay of the wake-up after each deadline [ns], or `PASSED`, to `late_out`.
    """
    begin_periods(deadlines, monotonic_ns())
    late_out[:] = PASSED
    while deadlines.tick + 1 < late_out.shape[0]:
        first = deadlines.tick + 1
        aim = next_deadline(deadlines, monotonic_ns())
        now = deadlines.asked_ns
        while now < aim:
            sleep_until(aim)
            now = monotonic_ns()
        woken(deadlines, now, aim)
        slept_for = first + deadlines.passed
        if slept_for < late_out.shape[0]:
            late_out[slept_for] = deadlines.late_ns
    return deadlines.missed_total


PHASE = np.dtype([("cosine", np.float64), ("sine", np.float64), ("samples", np.int64)], align=True)
"""Running means of the phase's cosine and sine, and the number of samples."""

WEIGHT = 1.0 / 128.0
"""Least weight of the newest sample: a mean of about half a second at 200 Hz."""
LEAST_SAMPLES = 48
"""Samples of another rate may seem to have a phase before there are so many."""
LEAST_RESULTANT = 0.7
"""Mean resultant length below which samples have no phase: a deviation of 0.13 periods."""
AFTER_MEAN = 0.5 * EARLIEST
"""Wanted time of a deadline after the mean phase, and largest jitter to either side [periods]."""
LEAST_INTERVAL = 0.75
"""Interval of samples below which they are never old [periods]."""
LARGEST_SHIFT = 1.0 / 5000.0
"""Largest shift of a deadline, and difference of a glove's clock from ours that can be followed [periods]."""


@jit
def count_phase(phase: Record, handed: int, period: int) -> None:
    """Add a sample that was handed over at `handed` [ns] to the phase in a loop's `period` [ns]."""
    angle = 2.0 * math.pi * float(handed % period) / float(period)
    sine, cosine = sine_cosine(angle)
    phase.samples += 1
    weight = max(1.0 / float(phase.samples), WEIGHT)
    phase.cosine += weight * (cosine - phase.cosine)
    phase.sine += weight * (sine - phase.sine)


@jit
def deadline_shift(phase: Record, deadline: int, period: int, interval: float) -> int:
    """Compute the shift of the next deadline from one period after `deadline` [ns], for a usual sample interval."""
    resultant = hypotenuse(phase.cosine, phase.sine)
    if phase.samples < LEAST_SAMPLES or resultant < LEAST_RESULTANT or interval < LEAST_INTERVAL * float(period):
        return as_int64(0)
    wanted = float(period) * (arc_tangent(phase.sine, phase.cosine) / (2.0 * math.pi) + AFTER_MEAN)
    off = (int(wanted) - deadline) % period
    if 2 * off > period:
        off -= period
    most = int(float(period) * LARGEST_SHIFT)
    return min(max(off, -most), most)


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


@lowered(int)
def _read_bytes(builder: Any, descriptor: Any, text: Any) -> Any:
    """Read a file from its beginning; return the number of bytes, or the system's -1."""
    word = ir.IntType(64)
    return call_c(builder, "pread", word, builder.trunc(descriptor, ir.IntType(32)), text.data, text.nitems, word(0))


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
