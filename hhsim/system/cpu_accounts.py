"""Who had the processor: what Linux says of a thread that had to wait for it, and of time that the host took."""

import contextlib
import os
import time
from pathlib import Path

STEAL_COLUMN = 8
"""Of a processor's line in /proc/stat, its name being column 0 (proc(5))."""
LINE_BYTES = 256
"""What a line of it has at most."""
UNKNOWN = -1


class CpuAccounts:
    """Accounts of the thread that opens it, and of the processors that it may use.

    Nothing here is a difference: whoever wants one reads twice. The descriptors stay open, so that a reading is one
    system call: 1 µs for `run_delay_ns`, some 20 µs for `steal_ns` on two processors.

    Args:
        cpu: The processor that the thread stays on; None for all that it may use together.
        proc: Where the accounts are.

    Attributes:
        processors: Those whose steal counts.
        schedule, stat: Descriptors of the thread's schedstat and of /proc/stat, -1 where there is none.
        stat_bytes: What the lines of all processors have in it at most.
        steal_step_ns: What `steal_ns` counts in [ns]: 10 ms on most systems, although the system knows better.
    """

    def __init__(self, cpu: int | None = None, proc: Path = Path("/proc")) -> None:
        """Open what there is; what there is not is `UNKNOWN` for good."""
        self.processors = tuple(sorted(os.sched_getaffinity(0))) if cpu is None else (cpu,)
        self._names = frozenset(f"cpu{number}".encode() for number in self.processors)
        self.stat = _opened(proc / "stat")
        # The path names the thread that opens it, and the descriptor stays with that one.
        self.schedule = _opened(proc / "thread-self" / "schedstat")
        # The lines of the processors come first, that of all together before them.
        self.stat_bytes = LINE_BYTES * ((os.cpu_count() or 1) + 1)
        self.steal_step_ns = 1_000_000_000 // os.sysconf("SC_CLK_TCK")

    def cpu_ns(self) -> int:
        """CPU time of the calling thread [ns]."""
        return time.thread_time_ns()

    def run_delay_ns(self) -> int:
        """How long the thread could have run and was not let, since it began [ns]; `UNKNOWN` where nobody counts it."""
        text = _read(self.schedule, LINE_BYTES)
        try:
            return int(text.split()[1])
        except (IndexError, ValueError):
            return UNKNOWN

    def steal_ns(self) -> int:
        """How long the host of a virtual machine ran something else, since it was started [ns]; `UNKNOWN` as above."""
        ticks, found = 0, False
        for line in _read(self.stat, self.stat_bytes).splitlines():
            fields = line.split()
            if fields and fields[0] in self._names and len(fields) > STEAL_COLUMN:
                ticks, found = ticks + int(fields[STEAL_COLUMN]), True
            elif found and not line.startswith(b"cpu"):
                break
        return ticks * self.steal_step_ns if found else UNKNOWN

    def close(self) -> None:
        """Let go of the descriptors; may be called twice."""
        for descriptor in (self.stat, self.schedule):
            if descriptor >= 0:
                with contextlib.suppress(OSError):
                    os.close(descriptor)
        self.stat = self.schedule = UNKNOWN


def risen(before: int, after: int) -> int:
    """By how much an account rose; 0 where one of the readings is `UNKNOWN`."""
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
