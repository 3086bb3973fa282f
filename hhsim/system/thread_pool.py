"""Threads for kernels that work on parts of their arrays; any number of threads gives the same bytes."""

import contextlib
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any, TypeVar

from hhsim.errors import InputError
from hhsim.system.posix import CREATE_FLAGS, lock, own_processors, pin

MOST_THREADS = 64

T = TypeVar("T")


def usual_threads() -> int:
    """Return one for each processor of this process, at most 4, since more hardly save time."""
    return min(len(own_processors()), 4)


class Workers(AbstractContextManager["Workers"]):
    """Threads that do parts in turn, in a `with`; 1 is the calling thread. InputError unless 1 to `MOST_THREADS`."""

    def __init__(self, threads: int = 1) -> None:
        if not 1 <= threads <= MOST_THREADS:
            raise InputError(f"{threads} threads, expected 1 to {MOST_THREADS}")
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None

    def __exit__(self, *_: object) -> None:
        if self._pool is not None:
            self._pool.shutdown()

    def each(self, work: Callable[..., T], parts: Iterable[tuple[Any, ...]]) -> list[T]:
        """Call `work(*part)` for every part; return the results in the order of the parts."""
        if self._pool is None:
            return [work(*part) for part in parts]
        return [future.result() for future in [self._pool.submit(work, *part) for part in parts]]


def ranges(count: int, parts: int) -> Iterator[tuple[int, int]]:
    """Yield at most `parts` consecutive, nearly equal ranges that cover range(count); none is empty unless all are."""
    parts = max(1, min(parts, count))
    for part in range(parts):
        yield count * part // parts, count * (part + 1) // parts


Answer = TypeVar("Answer")

LOOK_AGAIN = 0.05
"""Time between two attempts to claim a core [s]."""


def physical_cores() -> list[int]:
    """Return a processor of each physical core that this process may use; none if the system cannot pin threads."""
    if sys.platform != "linux":
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
    folder = Path(tempfile.gettempdir()) / f"hhsim-cores-{os.getuid()}"
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
