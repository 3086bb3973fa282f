"""What a busy machine takes of a drill's time: promises of so many milliseconds are judged with that taken out.

A session's processes are in real time where the system grants it, and wait for a processor all the same: for one
another, for the kernel, for the host of a virtual machine. The system keeps an account of it for each thread.
"""

import contextlib
import os
from pathlib import Path
from typing import Self

import pytest

from hhsim.live.cpu_accounts import CpuAccounts


class Late(AssertionError):
    """A promise of time that was not kept.

    The system's accounts leave out a part of what a busy machine takes (waits within the kernel, the host's own work).
    Such a part only makes a drill later, so that the earliest of three tries is the one to judge by: `keeps_time` tries
    a late drill again, and no other failure.
    """


keeps_time = pytest.mark.flaky(reruns=2, only_rerun=["^Late:"])


def assert_in_time(taken: int, allowed: int) -> None:
    """Fail unless what was promised within `allowed` took no longer [ns].

    Raises:
        Late: It took longer.
    """
    if taken > allowed:
        raise Late(f"{1e-6 * taken:.1f} ms, and {1e-6 * allowed:.1f} ms are allowed")


class MachineShare:
    """How long processes could have run since this was made, and were not let.

    Of a process with threads in real time, those alone count: the others carry nothing that a finger waits for.

    Args:
        processes: Their numbers; those that they start are looked at, too.
    """

    def __init__(self, *processes: int) -> None:
        """Read the accounts."""
        self._processes = processes
        self._accounts = CpuAccounts()
        self._steal = self._accounts.steal_ns()
        self._first: dict[int, int] = {}
        self.look()
        self._first = dict(self._last)

    def look(self) -> Self:
        """Read the accounts again; those of a thread that has ended stay as they were read last."""
        self._last = {**self._first, **getattr(self, "_last", {})}
        for process in self._processes:
            self._read(process)
        return self

    @property
    def taken_ns(self) -> int:
        """What the machine took, all threads together, and the host [ns]."""
        self.look()
        waited = sum(max(0, delay - self._first.get(thread, 0)) for thread, delay in self._last.items())
        return int(waited + max(0, self._accounts.steal_ns() - self._steal))

    def _read(self, process: int) -> None:
        delays: dict[int, tuple[bool, int]] = {}
        with contextlib.suppress(OSError):
            for task in Path(f"/proc/{process}/task").iterdir():
                with contextlib.suppress(OSError):
                    thread = int(task.name)
                    delay = int((task / "schedstat").read_text().split()[1])
                    delays[thread] = os.sched_getscheduler(thread) == os.SCHED_FIFO, delay
                    for child in map(int, (task / "children").read_text().split()):
                        self._read(child)
        in_time = any(real_time for real_time, _ in delays.values())
        self._last.update({thread: delay for thread, (real_time, delay) in delays.items() if real_time or not in_time})
