"""Atomic operations, held against what threads get wrong without them."""

import threading
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
import pytest

from hhsim.arrays import IntArray
from hhsim.kernels.parallel.atomic import (
    compare_exchange,
    fetch_add,
    load_acquire,
    pause,
    store_release,
    yield_processor,
)

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


@compiled  # type: ignore[untyped-decorator]
def send(shared: IntArray, letters: IntArray, count: int) -> None:
    for i in range(count):
        for j in range(letters.shape[0]):
            letters[j] = i + j
        store_release(shared, 0, i + 1)
        while load_acquire(shared, 16) != i + 1:
            pause()
            yield_processor()


@compiled  # type: ignore[untyped-decorator]
def receive(shared: IntArray, letters: IntArray, count: int) -> int:
    wrong = 0
    for i in range(count):
        while load_acquire(shared, 0) != i + 1:
            pause()
            yield_processor()
        for j in range(letters.shape[0]):
            wrong += letters[j] != i + j
        store_release(shared, 16, i + 1)
    return wrong


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


@pytest.mark.parametrize("count", [500, pytest.param(20_000, marks=pytest.mark.soak)])
def test_what_is_written_before_a_release_is_seen_after_the_acquire(count: int) -> None:
    shared, letters = np.zeros(32, np.int64), np.zeros(64, np.int64)
    send(shared, letters, 0)
    receive(shared, letters, 0)
    sender = threading.Thread(target=send, args=(shared, letters, count))
    sender.start()
    wrong = receive(shared, letters, count)
    sender.join()
    assert wrong == 0


@compiled  # type: ignore[untyped-decorator]
def one_by_one(shared: IntArray) -> tuple[int, int, bool, bool]:
    before = fetch_add(shared, 3, 10)
    return before, load_acquire(shared, 3), compare_exchange(shared, 3, 3, 99), compare_exchange(shared, 3, 13, -7)


def test_operations_return_what_was_there() -> None:
    shared = np.arange(8, dtype=np.int64)
    assert one_by_one(shared) == (3, 13, False, True)
    assert load_acquire(shared, 3) == -7
    store_release(shared, 0, 2**62)
    np.testing.assert_array_equal(shared, [2**62, 1, 2, -7, 4, 5, 6, 7])
