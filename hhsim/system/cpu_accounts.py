"""Accounts of Linux: waiting time of a thread for a processor, and time that the host took."""

import contextlib
import os
import time
from pathlib import Path

STEAL_COLUMN = 8
"""Column of a processor's line in /proc/stat, its name being column 0 (proc(5))."""
LINE_BYTES = 256
"""Longest line of /proc/stat [byte]."""
UNKNOWN = -1


class CpuAccounts:
    """Accounts of the thread that opens it, and of the `processors` that it may use, or `cpu` alone.

    All are totals; read twice for a difference. The descriptors, -1 if missing, stay open, so that a reading is one
    system call: 1 µs for `run_delay_ns`, some 20 µs for `steal_ns` on two processors, whose resolution is
    `steal_step_ns`, 10 ms on most systems.
    """

    def __init__(self, cpu: int | None = None, proc: Path = Path("/proc")) -> None:
        self.processors = tuple(sorted(os.sched_getaffinity(0))) if cpu is None else (cpu,)
        self._names = frozenset(f"cpu{number}".encode() for number in self.processors)
        self.stat = _opened(proc / "stat")
        # The path names the thread that opens it, and the descriptor stays with that one.
        self.schedule = _opened(proc / "thread-self" / "schedstat")
        # The lines of the processors come first, that of all together before them.
        self.stat_bytes = LINE_BYTES * ((os.cpu_count() or 1) + 1)
        self.steal_step_ns = 1_000_000_000 // os.sysconf("SC_CLK_TCK")

    def cpu_ns(self) -> int:
        """Return the CPU time of the calling thread [ns]."""
        return time.thread_time_ns()

    def run_delay_ns(self) -> int:
        """Return the time for which the thread was ready and did not run, since it began [ns], or `UNKNOWN`."""
        text = _read(self.schedule, LINE_BYTES)
        try:
            return int(text.split()[1])
        except (IndexError, ValueError):
            return UNKNOWN

    def steal_ns(self) -> int:
        """Return the time that the host of a virtual machine took, since its start [ns], or `UNKNOWN`."""
        ticks, found = 0, False
        for line in _read(self.stat, self.stat_bytes).splitlines():
            fields = line.split()
            if fields and fields[0] in self._names and len(fields) > STEAL_COLUMN:
                ticks, found = ticks + int(fields[STEAL_COLUMN]), True
            elif found and not line.startswith(b"cpu"):
                break
        return ticks * self.steal_step_ns if found else UNKNOWN

    def close(self) -> None:
        """Close the descriptors; may be called twice."""
        for descriptor in (self.stat, self.schedule):
            if descriptor >= 0:
                with contextlib.suppress(OSError):
                    os.close(descriptor)
        self.stat = self.schedule = UNKNOWN


def risen(before: int, after: int) -> int:
    """Return the increase of an account; 0 if one of the readings is `UNKNOWN`."""
    return max(0, after - before) if before >= 0 and after >= 0 else 0


def _opened(path: Path) -> int:
    try:
        return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return UNKNOWN


def _read(descriptor: int, most: int) -> bytes:
    if descriptor < 0:
        return b""
    try:
        return os.pread(descriptor, most, 0)
    except OSError:
        return b""
