"""The thread team's tickets: every item is taken once, by anybody, and a task is over when all of its items are."""

import threading

import numba
import numpy as np
import pytest

from hhsim.arrays import IntArray
from hhsim.kernels.parallel.thread_team import (
    DISMISSED,
    NOTHING,
    WORDS,
    await_done,
    dismiss,
    item_done,
    post,
    rest,
    take_item,
)

MOST = 6
"""Items of the largest task here."""


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def work_until_dismissed(word: IntArray, taken: IntArray, mine: IntArray) -> None:
    looks, item = 0, 0
    while item != DISMISSED:
        item = take_item(word)
        if item >= 0:
            looks = 0
            taken[item] += 1
            mine[0] += 1
            item_done(word)
        else:
            rest(looks)
            looks += 1


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def lead(word: IntArray, taken: IntArray, tasks: int) -> int:
    wrong = 0
    for number in range(tasks):
        items = 1 + number % MOST
        taken[:] = 0
        post(word, items)
        # Every now and then the helpers must do all of it: on a busy machine they might else never get to anything.
        while number % 200 != 0:
            item = take_item(word)
            if item == NOTHING:
                break
            taken[item] += 1
            item_done(word)
        await_done(word, items)
        for i in range(MOST):
            wrong += taken[i] != (1 if i < items else 0)
    dismiss(word)
    return wrong


@pytest.mark.parametrize("helpers", [1, 2, 3])
def test_every_item_of_every_task_is_done_once(helpers: int) -> None:
    word, taken = np.zeros(WORDS, np.int64), np.zeros(MOST, np.int64)
    mine = np.zeros((helpers, 16), np.int64)
    assert lead(word, taken, 0) == 0
    work_until_dismissed(word, taken, mine[0])
    post(word, 0)
    threads = [threading.Thread(target=work_until_dismissed, args=(word, taken, own)) for own in mine]
    for thread in threads:
        thread.start()
    assert lead(word, taken, 20_000) == 0
    for thread in threads:
        thread.join()
    assert mine.sum() >= sum(1 + number % MOST for number in range(0, 20_000, 200))
