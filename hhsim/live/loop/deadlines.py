"""The periods of a loop: absolute deadlines, of which those that cannot be met are skipped and counted."""

import ctypes
import errno
import os
import time
from typing import Protocol

CLOCK_MONOTONIC = 1
TIMER_ABSTIME = 1


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


_nanosleep = ctypes.CDLL(None).clock_nanosleep
_nanosleep.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.POINTER(_Timespec), ctypes.c_void_p)


class AbsoluteSleep:
    """Sleeps until a moment instead of for a time, so that what happens before the call is not added to it."""

    def __init__(self) -> None:
        """Allocate what every call uses."""
        self._time = _Timespec()
        self._pointer = ctypes.byref(self._time)

    def until(self, time_ns: int) -> None:
        """Sleep until CLOCK_MONOTONIC is `time_ns`, or until a signal has been handled.

        Raises:
            OSError: The system takes no such time.
        """
        self._time.seconds, self._time.nanoseconds = divmod(time_ns, 1_000_000_000)
        failure = _nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, self._pointer, None)
        if failure not in (0, errno.EINTR):
            raise OSError(failure, os.strerror(failure))


class Clock(Protocol):
    """A clock that can be slept by; times in ns."""

    def now(self) -> int:
        """The present."""

    def sleep_until(self, time_ns: int) -> None:
        """Return at `time_ns`, or earlier where a signal came."""


class MonotonicClock:
    """CLOCK_MONOTONIC."""

    def __init__(self) -> None:
        """Nothing is asked for yet."""
        self.now = time.monotonic_ns
        self.sleep_until = AbsoluteSleep().until


class Deadlines:
    """Deadlines that lie one period apart, counted from `start`.

    A deadline that has passed when `wait` is called is missed, however little: the loop goes on at the next one, so
    that ticks never follow each other without a pause and a loop that is too slow leaves the processor to others. A
    loop that is woken periods too late goes on at once, in the period that it is in.

    Args:
        period_ns: One period [ns].
        clock: CLOCK_MONOTONIC by default.

    Attributes:
        tick: Number of the present period, from 0; missed ones leave gaps.
        deadline_ns: When it began.
        asked_ns: When the loop began to wait: its work was done.
        woke_ns: When the loop woke.
        wakeup_ns: How long after `deadline_ns` that was.
        late_ns: How long after the deadline that was slept for; more than `wakeup_ns` where whole periods went by.
        missed: Periods between the tick before and this one.
        missed_total: Since the start.
    """

    def __init__(self, period_ns: int, clock: Clock | None = None) -> None:
        """No period has begun yet."""
        self.period_ns = period_ns
        self.clock: Clock = MonotonicClock() if clock is None else clock
        self.start()

    def start(self) -> None:
        """Begin to count: the first deadline is one period from now."""
        self.tick = -1
        self.deadline_ns = self.asked_ns = self.woke_ns = self.clock.now()
        self.wakeup_ns = self.late_ns = 0
        self.missed = self.missed_total = 0

    def wait(self) -> None:
        """Sleep until the next deadline."""
        clock, period = self.clock, self.period_ns
        deadline = self.deadline_ns + period
        now = self.asked_ns = clock.now()
        missed = 0
        if now >= deadline:
            missed = (now - deadline) // period + 1
            deadline += missed * period
        while now < deadline:
            clock.sleep_until(deadline)
            now = clock.now()
        late = now - deadline
        overslept = late // period
        missed += overslept
        self.tick += 1 + missed
        self.deadline_ns = deadline + overslept * period
        self.woke_ns = now
        self.wakeup_ns = late - overslept * period
        self.late_ns = late
        self.missed = missed
        self.missed_total += missed
