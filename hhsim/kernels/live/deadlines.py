"""Periods of a loop with absolute deadlines; a period in which no tick begins is missed.

A tick is due at its deadline, or with its input up to `EARLIEST` periods before it. Deadlines do not move with it, so
there is one tick a period.
"""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns, sleep_until
from hhsim.kernels.jit import Record, jit

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
