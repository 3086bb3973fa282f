"""The periods of a loop by a clock, in Python; the loop itself waits in `hhsim.kernels.live.loop`."""

import time
from collections.abc import Callable
from typing import Any, Protocol

from hhsim.kernels.live.deadlines import DEADLINES, NOTHING, begin_periods, due_time, next_deadline, woken
from hhsim.kernels.timed_wait import sleep_until
from hhsim.solver.workspace import zeroed


class Clock(Protocol):
    """A clock that can be slept by; times in ns."""

    def now(self) -> int:
        """The present."""

    def sleep_until(self, time_ns: int) -> None:
        """Return at `time_ns`, or earlier where a signal came."""


class MonotonicClock:
    """CLOCK_MONOTONIC."""

    def now(self) -> int:
        """See `Clock.now`."""
        return time.monotonic_ns()

    def sleep_until(self, time_ns: int) -> None:
        """See `Clock.sleep_until`."""
        sleep_until(time_ns)


class Deadlines:
    """Deadlines that lie one period apart, counted from `start`; `hhsim.kernels.live.deadlines` decides.

    Args:
        period_ns: One period [ns].
        clock: CLOCK_MONOTONIC by default.

    Attributes:
        state: Of `DEADLINES`, shape (1,).
        at: Its one record.
    """

    def __init__(self, period_ns: int, clock: Clock | None = None) -> None:
        """No period has begun yet."""
        self.clock: Clock = MonotonicClock() if clock is None else clock
        self.state = zeroed(DEADLINES)
        self.at: Any = self.state[0]
        self.at.period_ns = period_ns
        self.start()

    def start(self) -> None:
        """Begin to count: the first deadline is one period from now."""
        begin_periods(self.at, self.clock.now())

    def wait(self, waiting_since: Callable[[], int] = lambda: NOTHING) -> None:
        """Sleep until the next tick is due.

        Args:
            waiting_since: When something came that no tick has taken [ns], or `NOTHING`; what comes ends a sleep.
        """
        clock = self.clock
        now = clock.now()
        next_deadline(self.at, now)
        due = due_time(self.at, waiting_since(), now)
        while now < due:
            clock.sleep_until(due)
            now = clock.now()
            due = due_time(self.at, waiting_since(), now)
        woken(self.at, now, due)
