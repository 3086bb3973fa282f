"""Accounts of Linux: waiting time of a thread for a processor, and time that the host took."""

import contextlib
import os
import time
from pathlib import Path

import numpy as np

from hhsim.kernels.live.deadlines import UNKNOWN, read_run_delay, read_steal
from hhsim.kernels.live.loop import SystemFiles

LINE_BYTES = 256
"""Longest line of /proc/stat [byte]."""


class CpuAccounts:
    """Accounts of the thread that opens it, and of the `processors` that it may use, or `cpu` alone.

    All are totals; read twice for a difference. The descriptors, -1 if missing, stay open, so that a reading is one
    system call: 1 µs for `run_delay_ns`, some 20 µs for `steal_ns` on two processors, whose resolution is
    `steal_step_ns`, 10 ms on most systems.
    """

    def __init__(self, cpu: int | None = None, proc: Path = Path("/proc")) -> None:
        self.processors = sorted(os.sched_getaffinity(0)) if cpu is None else [cpu]
        self.stat = _opened(proc / "stat")
        # The path names the thread that opens it, and the descriptor stays with that one.
        self.schedule = _opened(proc / "thread-self" / "schedstat")
        self.steal_step_ns = 1_000_000_000 // os.sysconf("SC_CLK_TCK")
        self._files = self.files()

    def files(self, *events: int) -> SystemFiles:
        """Return the files for compiled code, with room of its own, and the events that wake the loop and drivers."""
        allowed = np.zeros(max(self.processors, default=0) + 1, np.bool_)
        allowed[self.processors] = True
        return SystemFiles(
            descriptors=np.array([self.schedule, self.stat, *events]),
            line=np.zeros(LINE_BYTES, np.uint8),
            # The lines of the processors come first, that of all together before them.
            lines=np.zeros(LINE_BYTES * ((os.cpu_count() or 1) + 1), np.uint8),
            allowed=allowed,
            step=np.array([self.steal_step_ns]),
        )

    def cpu_ns(self) -> int:
        """Return the CPU time of the calling thread [ns]."""
        return time.thread_time_ns()

    def run_delay_ns(self) -> int:
        """Return the time for which the thread was ready and did not run, since it began [ns], or `UNKNOWN`."""
        return int(read_run_delay(self.schedule, self._files.line))

    def steal_ns(self) -> int:
        """Return the time that the host of a virtual machine took, since its start [ns], or `UNKNOWN`."""
        return int(read_steal(self.stat, self._files.lines, self._files.allowed, self.steal_step_ns))

    def totals(self) -> tuple[int, int]:
        """Return `run_delay_ns` and `steal_ns`; the first call loads the kernels that read them."""
        return self.run_delay_ns(), self.steal_ns()

    def close(self) -> None:
        """Close the descriptors; may be called twice."""
        for descriptor in (self.stat, self.schedule):
            if descriptor >= 0:
                with contextlib.suppress(OSError):
                    os.close(descriptor)
        self.stat = self.schedule = UNKNOWN


def _opened(path: Path) -> int:
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return UNKNOWN
