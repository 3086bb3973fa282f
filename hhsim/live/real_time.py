"""Real-time requests of a loop to the system; a request that is refused is reported, and the loop runs without it."""

import contextlib
import ctypes
import errno
import gc
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

MCL_CURRENT, MCL_ONFAULT = 1, 4
PR_SET_PDEATHSIG, PR_SET_NAME, PR_SET_TIMERSLACK, PR_GET_TIMERSLACK = 1, 15, 29, 30

IDLE_LATENCY = Path("/dev/cpu_dma_latency")
"""An int written there [µs] limits, while the file is open, the wake-up time of idle processors
(docs.kernel.org, "PM Quality Of Service Interface")."""

_libc = ctypes.CDLL(None, use_errno=True)


@dataclass(frozen=True)
class RealTimeWishes:
    """Requests of a loop to the system."""

    # SCHED_FIFO at `priority`, timers that are not coalesced (1 ns instead of 50 µs), and idle processors that poll.
    punctual: bool = True
    priority: int = 50  # priority of the loop, 1 to 98; the watchdog runs one above
    lock_memory: bool = True  # keep all used pages in memory (mlock)
    cpu: int | None = None  # processor to stay on; None for the last one allowed, -1 for any
    freeze_gc: bool = True  # exclude existing objects from garbage collection

    def chosen(self) -> Self:
        """Return the same with the processor's number: all processes of a session have to know it."""
        allowed = os.sched_getaffinity(0)
        return replace(self, cpu=max(allowed)) if self.cpu is None and len(allowed) > 1 else self

    @property
    def loop_cpu(self) -> int:
        """Processor of the loop alone, -1 for none; of `chosen` wishes."""
        return -1 if self.cpu is None else self.cpu

    @classmethod
    def none(cls) -> Self:
        """Request nothing."""
        return cls(punctual=False, lock_memory=False, cpu=-1, freeze_gc=False)


def become_real_time(wishes: RealTimeWishes, *, above: int = 0) -> dict[str, Any]:
    """Apply the requests to the calling thread and its process, with `above` added to the priority.

    Returns:
        The achieved mode as plain values: `fifo`, the priority under SCHED_FIFO, 0 for the ordinary scheduler;
        `memory_locked`; `timer_slack_ns` of this thread; `cpu`, the processor that it stays on, -1 for any;
        `gc_frozen`, true if garbage collection is off; `awake`, set by `processors_awake`; `refused`, a line for every
        request that was refused.
    """
    refused: list[str] = []
    mode: dict[str, Any] = {"fifo": 0, "memory_locked": False, "timer_slack_ns": 0, "cpu": -1, "gc_frozen": False}
    mode |= {"awake": False, "refused": refused}
    if wishes.punctual:
        with _noted(refused, "timer slack stays as it is"):
            _check(_libc.prctl(PR_SET_TIMERSLACK, 1, 0, 0, 0))
    mode["timer_slack_ns"] = timer_slack()
    if wishes.cpu != -1:
        with _noted(refused, "not kept on one processor"):
            allowed = sorted(os.sched_getaffinity(0))
            cpu = allowed[-1] if wishes.cpu is None else wishes.cpu
            if wishes.cpu is None and len(allowed) == 1:
                raise OSError(errno.EINVAL, f"{cpu} is the only one there is")
            if cpu not in allowed:
                raise OSError(errno.EINVAL, f"the process may not use {cpu}, only {', '.join(map(str, allowed))}")
            os.sched_setaffinity(0, {cpu})
            mode["cpu"] = cpu
    if wishes.lock_memory:
        with _noted(refused, "memory is not locked", "; raise the limit memlock (ulimit -l)"):
            lock_memory()
            mode["memory_locked"] = True
    if wishes.freeze_gc:
        gc.collect()
        gc.freeze()
        gc.disable()
        mode["gc_frozen"] = True
    # Last: the requests above take longer than others of the same priority can wait.
    if wishes.punctual:
        priority = wishes.priority + above
        hint = "; raise the limit rtprio (ulimit -r), or grant CAP_SYS_NICE"
        with _noted(refused, f"no SCHED_FIFO at priority {priority}", hint):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            mode["fifo"] = priority
    return mode


@contextlib.contextmanager
def _noted(refused: list[str], what: str, hint: str = "") -> Iterator[None]:
    """Append a line to `refused` if the block raises OSError."""
    try:
        yield
    except OSError as error:
        refused.append(f"{what}: {error.strerror}{hint}")


@contextlib.contextmanager
def processors_awake(wishes: RealTimeWishes, mode: dict[str, Any]) -> Iterator[None]:
    """Keep idle processors awake during the block, if that is requested and granted, and note it in the `mode`.

    An idle processor takes 10 to 100 µs to wake, at each process that a sample passes, and longer under a host.
    """
    with contextlib.ExitStack() as opened:
        if wishes.punctual:
            what = f"processors without work may sleep: {IDLE_LATENCY}"
            with _noted(mode["refused"], what, "; allow writing to it (udev)"):
                device = opened.enter_context(IDLE_LATENCY.open("r+b", buffering=0))
                device.write(bytes(4))
                mode["awake"] = True
        yield


def keep_off(cpu: int) -> None:
    """Keep the calling thread off the loop's processor if it may use another one; -1 changes nothing."""
    others = os.sched_getaffinity(0) - {cpu}
    if others:
        with contextlib.suppress(OSError):
            os.sched_setaffinity(0, others)


def become_ordinary() -> None:
    """Return to the ordinary scheduler, for the time that a process takes to exit."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def name_process(name: str) -> None:
    """Name this process, and the threads that it will start, `hhsim-<name>`; in the main thread."""
    _libc.prctl(PR_SET_NAME, f"hhsim-{name}".encode(), 0, 0, 0)


def described(mode: dict[str, Any]) -> str:
    """Describe the achieved mode in one line."""
    return ", ".join(
        [
            f"SCHED_FIFO {mode['fifo']}" if mode["fifo"] else "ordinary scheduling",
            "memory locked" if mode["memory_locked"] else "memory not locked",
            f"timer slack {mode['timer_slack_ns']:,} ns",
            "any processor" if mode["cpu"] < 0 else f"processor {mode['cpu']}",
            "gc off" if mode["gc_frozen"] else "gc on",
            "processors awake" if mode.get("awake") else "processors may sleep",
        ]
    )


def lock_memory() -> None:
    """Keep the pages that this process has touched, and those of its mappings that it touches later, in memory.

    OSError if that is not allowed, or beyond the limit of locked memory.
    """
    _check(_libc.mlockall(MCL_CURRENT | MCL_ONFAULT))


def unlock_memory() -> None:
    """Unlock all memory; raises OSError if the system refuses."""
    _check(_libc.munlockall())


def timer_slack() -> int:
    """Return how late the system may wake this thread to coalesce timers [ns]."""
    return int(_check(_libc.prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0)))


def end_with(parent: int) -> bool:
    """Request SIGTERM for the end of the process `parent`, more exactly of its thread that started this process.

    Returns False if it has ended already: no signal will come. OSError if that is not allowed.
    """
    _check(_libc.prctl(PR_SET_PDEATHSIG, int(signal.SIGTERM), 0, 0, 0))
    return os.getppid() == parent


def _check(returned: int) -> int:
    if returned < 0:
        failure = ctypes.get_errno()
        raise OSError(failure, os.strerror(failure))
    return returned
