"""Threads for kernels that work on parts of their arrays; any number of threads gives the same bytes."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from typing import Any, TypeVar

from hhsim.errors import InputError
from hhsim.system.posix import own_processors

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
