"""Measurement of how punctually this machine wakes a thread that only waits, as a session's loop does."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hhsim.arrays import IntArray
from hhsim.kernels.live.deadlines import DEADLINES, PASSED, wait_periods
from hhsim.live.real_time import RealTimeWishes, become_real_time, processors_awake, unlock_memory
from hhsim.result.miss_cause import CAUSES, MissCause, TimeTaken
from hhsim.system.cpu_accounts import CpuAccounts, risen

BLOCK_SECONDS = 0.05
"""Time that compiled code waits by itself [s]; accounts are read between two blocks, which costs no period."""


@dataclass(frozen=True)
class Wakeups:
    """Outcome of a sequence of deadlines."""

    rate: float  # deadlines a second [Hz]
    late: IntArray  # time from deadline to wake-up [ns], one entry a wake-up
    missed: int  # number of deadlines that had passed when the thread woke from the one before
    streak: int  # largest number of them in a row
    causes: dict[MissCause, int]  # number of them by what took the time
    run_delay: int | None  # time in which the thread was ready and did not run [ns]; None if the system does not tell
    steal: int | None  # time in which the host had the thread's processors [ns], in the system's steps; None as above
    mode: dict[str, Any]  # mode that the system granted, as of `become_real_time`

    @property
    def periods(self) -> int:
        """Number of deadlines, missed ones included."""
        return len(self.late) + self.missed

    def percentile(self, percent: float) -> float:
        """Return the lateness [s] that `percent` of the wake-ups do not exceed, the nearest rank."""
        return 1e-9 * float(np.percentile(self.late, percent, method="inverted_cdf"))


def measure_wakeups(rate: float, seconds: float, wishes: RealTimeWishes) -> Wakeups:
    """Measure how late a thread with the requests of a loop wakes for deadlines, at `rate` [Hz] for `seconds`.

    The thread ends with the measurement, with Ctrl-C too, and what it was granted with it. The calling thread stays as
    it was, no memory stays locked, and the garbage collector is left alone.
    """
    stopping = threading.Event()
    with ThreadPoolExecutor(1, "hhsim-wakeups") as thread:
        try:
            return thread.submit(_measure, rate, seconds, wishes, stopping).result()
        finally:
            stopping.set()


def _measure(rate: float, seconds: float, wishes: RealTimeWishes, stopping: threading.Event) -> Wakeups:
    """Measure in this thread; see `measure_wakeups`."""
    # The first call compiles or loads the kernel, which is not waiting.
    wait_periods(_deadlines(1_000), np.zeros(1, np.int64))
    mode = become_real_time(replace(wishes, freeze_gc=False))
    accounts = CpuAccounts(None if mode["cpu"] < 0 else mode["cpu"])
    try:
        with processors_awake(wishes, mode):
            return _wait(rate, seconds, stopping, accounts, mode)
    finally:
        accounts.close()
        if mode["memory_locked"]:
            unlock_memory()


def _wait(
    rate: float, seconds: float, stopping: threading.Event, accounts: CpuAccounts, mode: dict[str, Any]
) -> Wakeups:
    period = round(1e9 / rate)
    count = max(1, round(seconds * rate))
    size = max(1, round(BLOCK_SECONDS * rate))
    block, deadlines = np.zeros(size, np.int64), _deadlines(period)
    late, missed, streak = [], 0, 0
    causes = dict.fromkeys(CAUSES, 0)
    first = before = accounts.run_delay_ns(), accounts.steal_ns()
    while count > 0 and not stopping.is_set():
        waits = block[: min(size, count)]
        passed = int(wait_periods(deadlines, waits))
        after = accounts.run_delay_ns(), accounts.steal_ns()
        woken = waits[waits != PASSED]
        if passed:
            # Deadlines that passed during a sleep, or before it could begin.
            overslept = woken[woken >= period]
            kept = max(int(overslept.sum()), passed * period)
            delay, steal = (risen(was, now) for was, now in zip(before, after, strict=True))
            cause = TimeTaken(computed=0, kept=kept, run_delay=delay, steal=steal, device=0).cause()
            causes[cause] += passed
            in_a_row = int(np.diff(np.flatnonzero(np.r_[True, waits != PASSED, True])).max()) - 1
            streak = max(streak, in_a_row, int(overslept.max(initial=0)) // period)
        late.append(woken)
        missed += passed
        count -= len(waits)
        before = after
    run_delay, stolen = (None if was < 0 or now < 0 else now - was for was, now in zip(first, before, strict=True))
    return Wakeups(rate, np.concatenate(late), missed, streak, causes, run_delay, stolen, mode)


def _deadlines(period: int) -> Any:
    state = np.zeros(1, DEADLINES).view(np.recarray)
    state.period_ns = period
    return state[0]
