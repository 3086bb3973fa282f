"""Processor core for each thread that is timed.

A core is claimed by a lock on a file in the system's temporary folder, which every process of the user sees and the
system releases when its holder ends. One thread of each physical core is claimed.
"""

import contextlib
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

from hhsim.system.posix import CREATE_FLAGS, can_pin, lock, own_processors, pin, user_number

Answer = TypeVar("Answer")

LOOK_AGAIN = 0.05
"""Time between two attempts to claim a core [s]."""


def physical_cores() -> list[int]:
    """Return a processor of each physical core that this process may use; none if the system cannot pin threads."""
    if not can_pin():
        return []
    found: dict[str, int] = {}
    for number in own_processors():
        siblings = Path(f"/sys/devices/system/cpu/cpu{number}/topology/thread_siblings_list")
        try:
            core = siblings.read_text(encoding="ascii").strip()
        except OSError:
            core = str(number)
        found.setdefault(core, number)
    return sorted(found.values())


def on_own_core(work: Callable[[], Answer]) -> tuple[Answer, bool]:
    """Call `work` in a thread pinned to a core of its own; wait for a core while all are claimed.

    Returns the answer, and True if there was such a core; False if the system cannot pin threads.
    """

    def pinned() -> tuple[Answer, bool]:
        with _claimed_core() as core:
            if core is not None:
                pin(core)
            return work(), core is not None

    with ThreadPoolExecutor(1) as thread:
        return thread.submit(pinned).result()


@contextlib.contextmanager
def _claimed_core() -> Iterator[int | None]:
    cores = physical_cores()
    folder = Path(tempfile.gettempdir()) / f"hhsim-cores-{user_number()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
    except OSError:
        cores = []
    if not cores:
        yield None
        return
    while True:
        for core in cores:
            file = os.open(folder / str(core), CREATE_FLAGS, 0o600)
            try:
                lock(file)
            except OSError:
                os.close(file)
                continue
            try:
                yield core
                return
            finally:
                os.close(file)
        time.sleep(LOOK_AGAIN)
