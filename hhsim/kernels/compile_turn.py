"""Turns of processes that need one kernel: the first compiles it, others wait and load it.

A turn is a lock of one byte of a file in the cache, at a place given by the kernel's file: such locks end with their
process, and need no file each. Where the system has none, nobody waits.
"""

import functools
import hashlib
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from hhsim.kernels.cache_folder import cache_root

PATIENCE = 60.0
"""Time for which one waits [s], before one compiles, too: the other process may be stopped."""
POLL = 0.01
"""Time between two looks [s]."""


class Turns:
    """The turns that this process has, one thread at a time; `on_wait` is called when it begins to wait."""

    def __init__(self, path: Path) -> None:
        self._path, self._patience = path, PATIENCE
        self._held: list[str] = []
        self.on_wait: Callable[[], None] = lambda: None

    @functools.cached_property
    def _file(self) -> int:
        """A descriptor that stays open: to close any of a file would end all locks that a process has on it."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """End all turns that are taken meanwhile, when that is done or fails."""
        before = len(self._held)
        try:
            yield
        finally:
            while len(self._held) > before:
                self._lock(self._held.pop(), taken=False)

    def take(self, kernel: str) -> bool:
        """Wait for the turn of a kernel, by the path of its file; return True if another process had it."""
        began, waited = time.monotonic(), False
        try:
            while not self._lock(kernel):
                if not waited:
                    self.on_wait()
                waited = True
                if time.monotonic() - began > self._patience:
                    self._patience = 0.0
                    return True
                time.sleep(POLL)
        except OSError:
            return waited
        self._held.append(kernel)
        return waited

    def _lock(self, kernel: str, taken: bool = True) -> bool:
        """Have a turn, or end it; return False if another process has it."""
        if sys.platform == "win32":
            return True
        import fcntl

        place = int.from_bytes(hashlib.sha256(kernel.encode()).digest()[:7], "big")
        what = fcntl.LOCK_EX | fcntl.LOCK_NB if taken else fcntl.LOCK_UN
        try:
            fcntl.lockf(self._file, what, 1, place)
        except (BlockingIOError, PermissionError):
            return False
        return True


TURNS = Turns(cache_root() / "turns")
"""Turns to compile what is not in the cache."""
