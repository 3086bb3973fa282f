"""What a loop asks the system for, so that it wakes on time; what is not granted is said and done without."""

import contextlib
import gc
import os
import platform
from pathlib import Path
from typing import Any

from hhsim.live.ipc.config import RealTimeWishes
from hhsim.live.linux_calls import lock_memory, set_timer_slack, timer_slack

THROTTLE = Path("/proc/sys/kernel/sched_rt_runtime_us")
"""How much of a second all real-time processes together may take [µs]; -1 for all of it."""


def become_real_time(wishes: RealTimeWishes, *, above: int = 0) -> dict[str, Any]:
    """Ask the system for what is wished, for the calling thread and its process.

    Args:
        wishes: what is wished.
        above: how much higher than `wishes.priority` this process is to stand.

    Returns:
        The mode that was achieved, as plain values:

        | key | meaning |
        |---|---|
        | fifo | priority under SCHED_FIFO, 0 for the ordinary scheduler |
        | memory_locked | whether no page can be taken away |
        | timer_slack_ns | of this thread |
        | cpu | the processor that it stays on, -1 for any |
        | gc_frozen | whether garbage collection is off and what is there is not looked at again |
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
            lock_memory()
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


def become_ordinary() -> None:
    """Give the priority back, before a process that is done takes its time to go."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def described(mode: dict[str, Any]) -> str:
    """The achieved mode in one line."""
    parts = [f"SCHED_FIFO {mode['fifo']}" if mode["fifo"] else "ordinary scheduling"]
    parts.append("memory locked" if mode["memory_locked"] else "memory not locked")
    parts.append(f"timer slack {mode['timer_slack_ns']:,} ns")
    parts.append("any processor" if mode["cpu"] < 0 else f"processor {mode['cpu']}")
    parts.append("gc off" if mode["gc_frozen"] else "gc on")
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
