"""The periods of a loop: absolute deadlines; a period in which no tick begins is missed, and counted.

The loop of a session and the one that only measures wake-ups count by the same code. A tick is due at its deadline, or
before it when what it waits for comes, by `EARLIEST` periods at most: the deadlines stay where they are, so that there
is one tick a period all the same.
"""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.jit import Record, jit
from hhsim.kernels.timed_wait import sleep_until

PASSED = -1
"""Stands for a deadline that could not be slept for."""
NOTHING = -1
"""Stands for the time at which something came, where nothing has."""
EARLIEST = 0.75
"""Of a period: so long before its deadline a tick may be due at most."""

DEADLINES = np.dtype(
    [
        ("period_ns", np.int64),
        ("shift_ns", np.int64),
        ("tick", np.int64),
        ("deadline_ns", np.int64),
        ("early_ns", np.int64),
        ("asked_ns", np.int64),
        ("woke_ns", np.int64),
        ("wakeup_ns", np.int64),
        ("late_ns", np.int64),
        ("missed", np.int64),
        ("missed_total", np.int64),
        ("aim_ns", np.int64),
        ("passed", np.int64),
        ("at_once", np.int64),
    ],
    align=True,
)
"""Where a loop is among its periods; times are CLOCK_MONOTONIC [ns].

| field | meaning |
|---|---|
| period_ns | one period |
| shift_ns | how much longer the present one is |
| tick | number of the present one, from 0; missed ones leave gaps |
| deadline_ns | when it was to begin at the latest |
| early_ns | so long before that it was due, since something had come; 0: nothing had |
| asked_ns | when the loop began to wait: its work was done |
| woke_ns | when it woke |
| wakeup_ns | how long after it was due that was |
| late_ns | how long after what was slept for; more than `wakeup_ns` where whole periods went by |
| missed, missed_total | periods between the tick before and this one, and since the start |
| aim_ns, passed | the deadline that is slept for, and the periods that had passed before |
| at_once | 1: the work before ended in this period, which began without a sleep |
"""


@jit
def begin_periods(deadlines: Record, now: int) -> None:
    """Begin to count: the first deadline is one period from now [ns]."""
    deadlines.tick = -1
    deadlines.deadline_ns = deadlines.asked_ns = deadlines.woke_ns = now
    deadlines.early_ns = deadlines.wakeup_ns = deadlines.late_ns = deadlines.missed = deadlines.missed_total = 0
    deadlines.aim_ns = now
    deadlines.passed = deadlines.at_once = deadlines.shift_ns = 0


@jit
def next_deadline(deadlines: Record, now: int) -> int:
    """The deadline to sleep for [ns].

    A tick that was woken late may end a little after the deadline of the next one, which then begins at once: most of
    its period is left. It does so in the first half of the period, and after a tick that was slept for: three never
    follow each other without a pause, and a loop that is too slow leaves the processor to others. Any other deadline
    that has passed is missed.
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
    """When the tick that is waited for is due [ns]: with what comes, or else at its deadline.

    A loop whose work was not done when its tick could have been due at the earliest keeps to its deadline, as does one
    that wakes after that: each early tick follows on a pause.

    Args:
        deadlines: After `next_deadline`.
        came: When something came that the tick is to begin with [ns], or `NOTHING`.
        now: The present [ns].
    """
    aim = deadlines.aim_ns
    earliest = aim - int(EARLIEST * float(deadlines.period_ns))
    if came == NOTHING or now >= aim or deadlines.asked_ns > earliest or deadlines.passed > 0:
        return aim
    return min(max(came, earliest), aim)


@jit
def woken(deadlines: Record, now: int, due: int) -> None:
    """The loop woke; where that is periods too late, it goes on in the period that it is in.

    Args:
        deadlines: After `next_deadline`.
        now: The present, not before `due` [ns].
        due: Of `due_time` [ns].
    """
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
def await_deadline(deadlines: Record) -> None:
    """Sleep until the next deadline."""
    aim = next_deadline(deadlines, monotonic_ns())
    now = deadlines.asked_ns
    while now < aim:
        sleep_until(aim)
        now = monotonic_ns()
    woken(deadlines, now, aim)


@jit
def wait_periods(deadlines: Record, late_out: NDArray[np.int64]) -> int:
    """Wait for a row of deadlines, the first of them a period from now, and do nothing else.

    Args:
        deadlines: Of `DEADLINES`, with its period.
        late_out: One entry a deadline: how long after it the thread woke [ns], or `PASSED`.

    Returns:
        How many deadlines were missed, those beyond the row too.
    """
    begin_periods(deadlines, monotonic_ns())
    late_out[:] = PASSED
    while deadlines.tick + 1 < late_out.shape[0]:
        first = deadlines.tick + 1
        await_deadline(deadlines)
        slept_for = first + deadlines.passed
        if slept_for < late_out.shape[0]:
            late_out[slept_for] = deadlines.late_ns
    return deadlines.missed_total
