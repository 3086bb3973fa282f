"""Atomic operations, held against what threads get wrong without them."""

import threading
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest

from hhsim.arrays import IntArray
from hhsim.kernels.parallel.atomic import compare_exchange, fetch_add, load_acquire

compiled = numba.njit(nogil=True)


@compiled  # type: ignore[untyped-decorator]
def add_up(shared: IntArray, place: int, times: int) -> None:
    for _ in range(times):
        fetch_add(shared, place, 1)


@compiled  # type: ignore[untyped-decorator]
def exchange_up(shared: IntArray, place: int, times: int) -> int:
    lost = 0
    for _ in range(times):
        before = load_acquire(shared, place)
        while not compare_exchange(shared, place, before, before + 3):
            lost += 1
            before = load_acquire(shared, place)
    return lost


def in_threads(count: int, work: Callable[..., Any], *arguments: Any) -> list[Any]:
    """Run the same work in several threads at once; returns what each returned."""
    work(*arguments[:-1], 0)  # compiled before the threads begin
    begin = threading.Barrier(count)
    results = []

    def run() -> None:
        begin.wait()
        results.append(work(*arguments))

    threads = [threading.Thread(target=run) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


@pytest.mark.parametrize("threads", [2, 3, 4])
@pytest.mark.parametrize(("work", "times", "step"), [(add_up, 200_000, 1), (exchange_up, 100_000, 3)])
def test_contended_words_lose_nothing(work: Callable[..., Any], times: int, step: int, threads: int) -> None:
    for place in (5, 63):
        shared = np.zeros(64, np.int64)
        in_threads(threads, work, shared, place, times)
        assert shared[place] == step * times * threads
        assert shared.sum() == shared[place], "a neighbour was written"
