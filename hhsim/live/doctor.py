"""Verdict on whether this machine keeps a loop's rate, and who takes the time if not: `hhsim doctor`.

Measured wake-ups of a thread that only waits, as a session's loop does, decide, by the limits below.
"""

import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hhsim.arrays import IntArray
from hhsim.kernels.live.deadlines import DEADLINES, PASSED, wait_periods
from hhsim.live.cpu_accounts import CpuAccounts
from hhsim.live.real_time import RealTimeWishes, become_real_time, processors_awake, unlock_memory

BLOCK_SECONDS = 0.05
"""Time that compiled code waits by itself [s]: Ctrl-C ends a measurement between two blocks."""
MOST_MISSED = 1e-3
"""Fraction of the periods that a thread that only waits may miss, so that a loop has the rest of its period to work."""
MOST_LATE = 0.25
"""Fraction of a period that 99 of 100 wake-ups must not exceed: a tick and its commands still fit into the rest."""
MOST_IN_A_ROW = 9
"""A session frees the fingers at ten (`SafetyLimits.overruns`)."""
ONE_ALONE = 1
"""Missed periods that are always allowed: a short look cannot tell one from none."""
QUICK_SECONDS = 0.3
NOT_TOLD = "not told"
"""Value of what the system does not report."""
HOST_ADVICE = "the host took the processor: nothing set in here helps; a machine, or a processor, of one's own"
OTHERS_ADVICE = "other work had the processor: end it, or set a processor aside (isolcpus) and name it (--cpu)"
NOBODY_ADVICE = (
    "no account says who had the processor when the thread was woken late: in a virtual machine most often a host that "
    "does not tell, else the firmware (system management), or the kernel's own work, where it does not interrupt that"
)


@dataclass(frozen=True)
class Row:
    """Row of the doctor's table: a figure, with a limit if it decides."""

    name: str
    value: float | str
    limit: float | None = None
    unit: str = ""

    @property
    def kept(self) -> bool:
        """True if there is no limit, or it is kept."""
        return self.limit is None or float(self.value) <= self.limit


@dataclass(frozen=True)
class Wakeups:
    """Outcome of a sequence of deadlines, and what follows from it."""

    rate: float  # deadlines a second [Hz]
    late: IntArray  # time from deadline to wake-up [ns], one entry a wake-up
    missed: int  # number of deadlines that had passed when the thread woke from the one before
    streak: int  # largest number of them in a row
    run_delay: int | None  # time in which the thread was ready and did not run [ns]; None if the system does not tell
    steal: int | None  # time in which the host had the thread's processors [ns], in the system's steps; None as above
    mode: dict[str, Any]  # mode that the system granted, as of `become_real_time`

    @property
    def periods(self) -> int:
        """Number of deadlines, missed ones included."""
        return len(self.late) + self.missed

    @property
    def rows(self) -> list[Row]:
        """Rows of the table; the first three have limits and decide the verdict."""
        allowed = int(max(MOST_MISSED * self.periods, ONE_ALONE))
        # By the nearest rank [µs].
        percentiles = 1e6 * (1e-9 * np.percentile(self.late, (50.0, 99.0, 99.9, 100.0), method="inverted_cdf"))
        p50, p99, p999, longest = percentiles.tolist()
        accounts = (("run delay", self.run_delay), ("steal (the host had it)", self.steal))
        return [
            Row("missed periods", self.missed, float(allowed)),
            Row("missed in a row", self.streak, MOST_IN_A_ROW),
            Row("wake-up, p99", p99, 1e6 * MOST_LATE / self.rate, "µs"),
            Row("wake-up, p50", p50, unit="µs"),
            Row("wake-up, p99.9", p999, unit="µs"),
            Row("wake-up, longest", longest, unit="µs"),
            *(Row(name, NOT_TOLD if ns is None else f"{1e-6 * ns:,.1f}", unit="ms") for name, ns in accounts),
        ]

    @property
    def good(self) -> bool:
        """True if every limit is kept."""
        return all(row.kept for row in self.rows)

    @property
    def verdict(self) -> str:
        """Verdict in one sentence, with who had the processor meanwhile."""
        missed = f"none of {self.periods:,} periods was missed"
        if self.missed:
            accounts = (("the host", self.steal), ("other work", self.run_delay))
            took = ", ".join(f"{who} had the processor for {1e-6 * ns:,.1f} ms" for who, ns in accounts if ns)
            missed = f"{self.missed:,} of {self.periods:,} periods were missed{took and f' ({took})'}"
        # The first row is that of the missed periods, which end the sentence.
        beyond = [
            f"{row.name} {row.value:,.0f} {row.unit} (at most {row.limit:,.0f})".replace("  ", " ")
            for row in self.rows[1:]
            if not row.kept
        ]
        return f"this machine {'keeps' if self.good else 'does not keep'} {self.rate:,g} Hz: " + ", ".join(
            [*beyond, missed]
        )

    @property
    def advice(self) -> list[str]:
        """Changes that may help, the most telling first; empty if every limit is kept."""
        if self.good:
            return []
        found = []
        if self.missed:
            # Half of the time: an account that explains less is not the reason.
            least = 0.5e9 * self.missed / self.rate
            accounts = ((HOST_ADVICE, self.steal), (OTHERS_ADVICE, self.run_delay))
            found = [advice for advice, ns in accounts if ns is not None and ns >= least] or [NOBODY_ADVICE]
        return [*found, *self.mode["refused"]]

    def to_json(self) -> dict[str, Any]:
        """Return all of it as plain values: the rows as in the table, other times in SI units."""
        return {
            **{name: getattr(self, name) for name in ("good", "verdict", "advice", "rate", "periods", "missed")},
            "run_delay": None if self.run_delay is None else 1e-9 * self.run_delay,
            "steal": None if self.steal is None else 1e-9 * self.steal,
            "real_time": self.mode,
            "rows": [asdict(row) | {"kept": row.kept} for row in self.rows],
        }


def measure_wakeups(rate: float, seconds: float, wishes: RealTimeWishes) -> Wakeups:
    """Measure how late a thread with the requests of a loop wakes for deadlines, at `rate` [Hz] for `seconds`.

    The thread ends with the measurement, with Ctrl-C too, and what it was granted with it. The calling thread stays as
    it was, no memory stays locked, and the garbage collector is left alone.
    """
    stopping = threading.Event()

    def measure() -> Wakeups:
        deadlines: Any = np.zeros(1, DEADLINES).view(np.recarray)[0]
        block = np.zeros(max(1, round(BLOCK_SECONDS * rate)), np.int64)
        # The first calls compile or load the kernels, which is not waiting.
        deadlines.period_ns = 1_000
        wait_periods(deadlines, block[:1])
        with closing(CpuAccounts(None)) as first:
            first.totals()
        deadlines.period_ns = period = round(1e9 / rate)
        count, missed, streak = max(1, round(seconds * rate)), 0, 0
        late: list[IntArray] = []
        mode = become_real_time(replace(wishes, freeze_gc=False))
        accounts = CpuAccounts(None if mode["cpu"] < 0 else mode["cpu"])
        try:
            with closing(accounts), processors_awake(wishes, mode):
                before = accounts.totals()
                while count > 0 and not stopping.is_set():
                    waits = block[:count]
                    missed += int(wait_periods(deadlines, waits))
                    late.append(waits[waits != PASSED])
                    # Deadlines that passed before a sleep could begin, or during one.
                    in_a_row = int(np.diff(np.flatnonzero(np.r_[True, waits != PASSED, True])).max()) - 1
                    streak = max(streak, in_a_row, int(late[-1].max(initial=0)) // period)
                    count -= len(waits)
                after = accounts.totals()
        finally:
            if mode["memory_locked"]:
                unlock_memory()
        run_delay, stolen = (None if was < 0 or now < 0 else now - was for was, now in zip(before, after))
        return Wakeups(rate, np.concatenate(late), missed, streak, run_delay, stolen, mode)

    with ThreadPoolExecutor(1, "hhsim-wakeups") as thread:
        try:
            return thread.submit(measure).result()
        finally:
            stopping.set()


def quick_warning(rate: float, wishes: RealTimeWishes) -> str:
    """Check for `QUICK_SECONDS` whether the machine keeps `rate` [Hz] now; returns a warning, "" if it does.

    Memory is not locked: that would take longer than the check.
    """
    found = measure_wakeups(rate, QUICK_SECONDS, replace(wishes, lock_memory=False))
    return "" if found.good else f"{found.verdict}; hhsim doctor tells more"
