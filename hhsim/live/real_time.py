"""What a loop asks the system for, so that it wakes on time; what is not granted is said and done without."""

import contextlib
import ctypes
import gc
import os
import platform
import signal
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from hhsim.errors import InputError

MCL_CURRENT, MCL_FUTURE, MCL_ONFAULT = 1, 2, 4
MLOCK_ONFAULT = 1
PR_SET_PDEATHSIG, PR_SET_TIMERSLACK, PR_GET_TIMERSLACK = 1, 29, 30

THROTTLE = Path("/proc/sys/kernel/sched_rt_runtime_us")
"""How much of a second all real-time processes together may take [µs]; -1 for all of it."""
IDLE_LATENCY = Path("/dev/cpu_dma_latency")
"""What is written there [µs, an int] limits, while it is open, how long a processor that sleeps may take to wake
(docs.kernel.org, "PM Quality Of Service Interface")."""

_libc = ctypes.CDLL(None, use_errno=True)
_prctl = _libc.prctl
_prctl.argtypes = (ctypes.c_int, ctypes.c_ulong, ctypes.c_ulong, ctypes.c_ulong, ctypes.c_ulong)
_mlockall = _libc.mlockall
_mlockall.argtypes = (ctypes.c_int,)
_munlockall = _libc.munlockall
_mlock2 = _libc.mlock2
_mlock2.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint)

MAPPINGS = Path("/proc/self/maps")
SYSTEM_LIBRARIES = ("libc.so", "libc-", "libm.so", "libm-", "ld-linux", "ld-musl")
"""Of the files that a process has mapped, those that compiled code calls."""


@dataclass(frozen=True)
class RealTimeWishes:
    """What the loop asks the system for; each wish that is not granted is said and done without.

    Attributes:
        fifo: SCHED_FIFO, at `priority`, 1 to 98; the watchdog runs one above.
        priority: Of the loop.
        lock_memory: No page that is used is taken away (mlock).
        timer_slack: Wake-ups are not put together with others (1 ns instead of 50 µs).
        cpu: The processor to stay on, None to choose the last that the process may use, -1 not to be pinned.
        freeze_gc: What is there when the loop begins is no more looked through for garbage.
        awake: A processor that has nothing to do polls for work instead of sleeping.
    """

    fifo: bool = True
    priority: int = 50
    lock_memory: bool = True
    timer_slack: bool = True
    cpu: int | None = None
    freeze_gc: bool = True
    awake: bool = True

    def chosen(self) -> Self:
        """The same with the processor's number, where there is a choice: every process of a session has to know it."""
        allowed = os.sched_getaffinity(0)
        return replace(self, cpu=max(allowed)) if self.cpu is None and len(allowed) > 1 else self

    @property
    def loop_cpu(self) -> int:
        """The processor that the loop has to itself, -1 for none; of `chosen` wishes."""
        return -1 if self.cpu is None else self.cpu

    @classmethod
    def none(cls) -> Self:
        """Ask for nothing."""
        return cls(fifo=False, lock_memory=False, timer_slack=False, cpu=-1, freeze_gc=False, awake=False)

    def __post_init__(self) -> None:
        """Refuse a priority that leaves no room for the watchdog.

        Raises:
            InputError: A priority or a processor out of range.
        """
        if not 1 <= self.priority <= 98:
            raise InputError(f"the real-time priority is {self.priority}: expected 1 to 98")
        if self.cpu is not None and self.cpu < -1:
            raise InputError(f"the processor is {self.cpu}: expected its number, or -1 not to be pinned")


def become_real_time(wishes: RealTimeWishes, *, above: int = 0, interpreter: bool = True) -> dict[str, Any]:
    """Ask the system for what is wished, for the calling thread and its process.

    Args:
        above: How much higher than `wishes.priority` this process is to stand.
        interpreter: As of `lock_memory`.

    Returns:
        The mode that was achieved, as plain values:

        | key | meaning |
        |---|---|
        | fifo | priority under SCHED_FIFO, 0 for the ordinary scheduler |
        | memory_locked | whether no page can be taken away |
        | timer_slack_ns | of this thread |
        | cpu | the processor that it stays on, -1 for any |
        | gc_frozen | whether garbage collection is off and what is there is not looked at again |
        | awake | whether processors are kept from sleeping, which `processors_awake` does |
        | timer | how deadlines are slept for |
        | kernel | release of the system |
        | throttle_us | what real-time processes may take of a second, 0 where it is not known |
        | refused | a line for every wish that was not granted |
    """
    refused: list[str] = []
    mode: dict[str, Any] = {
        "fifo": 0,
        "memory_locked": False,
        "timer_slack_ns": 0,
        "cpu": -1,
        "gc_frozen": False,
        "awake": False,
        "timer": "clock_nanosleep, absolute",
        "kernel": platform.release(),
        "throttle_us": _throttle(),
        "refused": refused,
    }
    if wishes.timer_slack:
        try:
            set_timer_slack(1)
        except OSError as error:
            refused.append(f"timer slack stays as it is: {error.strerror}")
    mode["timer_slack_ns"] = timer_slack()
    if wishes.cpu != -1:
        try:
            mode["cpu"] = _stay_on(wishes.cpu)
        except OSError as error:
            refused.append(f"not kept on one processor: {error.strerror}")
        except _NoChoice as reason:
            refused.append(f"not kept on one processor: {reason}")
    if wishes.lock_memory:
        try:
            lock_memory(interpreter=interpreter)
            mode["memory_locked"] = True
        except OSError as error:
            refused.append(f"memory is not locked: {error.strerror}; raise the limit memlock (ulimit -l)")
    if wishes.freeze_gc:
        gc.collect()
        gc.freeze()
        gc.disable()
        mode["gc_frozen"] = True
    # Last: what comes before takes longer than others of the same priority can wait.
    if wishes.fifo:
        priority = wishes.priority + above
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
            mode["fifo"] = priority
        except OSError as error:
            refused.append(
                f"no SCHED_FIFO at priority {priority}: {error.strerror}; raise the limit rtprio (ulimit -r), or grant "
                "CAP_SYS_NICE"
            )
    return mode


@contextlib.contextmanager
def processors_awake(wishes: RealTimeWishes, mode: dict[str, Any]) -> Iterator[None]:
    """Let no processor sleep while the block runs, if that is wished and granted.

    To wake one that sleeps takes 10 to 100 µs, with each process on a sample's way, and more so under a host.

    Args:
        wishes: Of the loop.
        mode: As of `become_real_time`; it is said there what was granted.
    """
    with contextlib.ExitStack() as opened:
        if wishes.awake:
            try:
                device = opened.enter_context(IDLE_LATENCY.open("r+b", buffering=0))
                device.write(bytes(4))
                mode["awake"] = True
            except OSError as error:
                mode["refused"].append(
                    f"processors without work may sleep: {IDLE_LATENCY}: {error.strerror}; allow writing to it (udev)"
                )
        yield


def keep_off(cpu: int) -> None:
    """Leave a processor to the loop, where the calling thread may use another one; nothing where that is -1."""
    others = os.sched_getaffinity(0) - {cpu}
    if others:
        with contextlib.suppress(OSError):
            os.sched_setaffinity(0, others)


def become_ordinary() -> None:
    """Give the priority back, before a process that is done takes its time to go."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


PR_SET_NAME = 15


def name_process(name: str) -> None:
    """Call this process, and the threads that it will start, `hhsim-<name>`; does nothing where it is not Linux.

    To be called in the main thread: Linux takes the name of a process from that.
    """
    if platform.system() == "Linux":
        ctypes.CDLL(None).prctl(PR_SET_NAME, f"hhsim-{name}".encode(), 0, 0, 0)


def described(mode: dict[str, Any]) -> str:
    """The achieved mode in one line."""
    parts = [f"SCHED_FIFO {mode['fifo']}" if mode["fifo"] else "ordinary scheduling"]
    parts.append("memory locked" if mode["memory_locked"] else "memory not locked")
    parts.append(f"timer slack {mode['timer_slack_ns']:,} ns")
    parts.append("any processor" if mode["cpu"] < 0 else f"processor {mode['cpu']}")
    parts.append("gc off" if mode["gc_frozen"] else "gc on")
    parts.append("processors awake" if mode.get("awake") else "processors may sleep")
    return ", ".join(parts)


class _NoChoice(Exception):
    """Staying on a processor would make things worse."""


def _stay_on(wish: int | None) -> int:
    allowed = sorted(os.sched_getaffinity(0))
    if wish is None:
        if len(allowed) == 1:
            raise _NoChoice(f"{allowed[0]} is the only one there is")
        wish = allowed[-1]
    elif wish not in allowed:
        raise _NoChoice(f"the process may not use {wish}, only {', '.join(map(str, allowed))}")
    os.sched_setaffinity(0, {wish})
    return wish


def _throttle() -> int:
    try:
        return int(THROTTLE.read_text())
    except (OSError, ValueError):
        return 0


def lock_memory(*, interpreter: bool = True) -> None:
    """Keep the pages in memory that the process uses; those that it never touches take no room.

    Args:
        interpreter: Whether Python is run in time. Compiled code alone uses data, its own code and what it shares with
            other processes, and none of the libraries that it was made with.

    Raises:
        OSError: Not allowed, or more than the limit of locked memory.
    """
    if interpreter:
        _check(_mlockall(MCL_CURRENT | MCL_FUTURE | MCL_ONFAULT))
        return
    for line in MAPPINGS.read_text().splitlines():
        span, rights, _, _, inode, *name = line.split(maxsplit=5)
        path = name[0] if name else ""
        shared = path.startswith("/memfd:")
        library = inode != "0" and not shared
        if "r" not in rights or path.startswith("[v") or (library and not _is_system_library(path)):
            continue
        begin, end = (int(number, 16) for number in span.split("-"))
        # Shared memory is not yet touched where the others will write; it has a size of its own.
        _check(_mlock2(begin, end - begin, 0 if shared else MLOCK_ONFAULT))


def _is_system_library(path: str) -> bool:
    return Path(path).name.startswith(SYSTEM_LIBRARIES)


def unlock_memory() -> None:
    """Take `lock_memory` back.

    Raises:
        OSError: The system refuses.
    """
    _check(_munlockall())


def set_timer_slack(slack_ns: int) -> None:
    """How late a wake-up of this thread may be made in order to put it together with others [ns].

    Raises:
        OSError: Not allowed.
    """
    _check(_prctl(PR_SET_TIMERSLACK, slack_ns, 0, 0, 0))


def timer_slack() -> int:
    """What `set_timer_slack` sets [ns]."""
    return int(_check(_prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0)))


def end_with(parent: int) -> bool:
    """Be sent SIGTERM when the parent ends, or rather the thread of it that started this process.

    Args:
        parent: Its process id.

    Returns:
        False where it has ended already: no signal will come.

    Raises:
        OSError: Not allowed.
    """
    _check(_prctl(PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0))
    return os.getppid() == parent


def _check(returned: int) -> int:
    if returned < 0:
        failure = ctypes.get_errno()
        raise OSError(failure, os.strerror(failure))
    return returned
