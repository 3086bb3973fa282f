"""The thread team's tickets: every item is taken once, by anybody, and a task is over when all of its items are."""

import threading
import time
from typing import Any

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.arrays import IntArray
from hhsim.kernels.clock import cpu_ns, thread_cpu_ns
from hhsim.kernels.parallel.thread_team import (
    DONE,
    NOTHING,
    PARTS,
    TASK_DISTANCES,
    TASK_FINGERS,
    TASK_STOP,
    THREAD_TEAM,
    TICKET,
    WORDS,
    assemble,
    await_done,
    dismiss,
    item_done,
    post,
    rest,
    sort_parts,
    take_item,
    thread_team_cpu_ns,
    waiting_task,
)


def fresh() -> Any:
    return np.zeros(1, THREAD_TEAM).view(np.recarray)[0]


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def work_until_dismissed(word: IntArray, taken: IntArray, mine: IntArray) -> None:
    looks = 0
    while True:
        task = waiting_task(word)
        if task == NOTHING:
            rest(looks)
            looks += 1
            continue
        if task == TASK_STOP:
            return
        looks = 0
        item = take_item(word, task)
        if item != NOTHING:
            taken[item] += 1
            mine[0] += 1
            item_done(word)


@numba.njit(nogil=True)  # type: ignore[untyped-decorator]
def lead(word: IntArray, taken: IntArray, tasks: int) -> int:
    wrong = 0
    for number in range(tasks):
        items = 1 + number % PARTS
        taken[:] = 0
        task = TASK_DISTANCES if number % 3 else TASK_FINGERS
        post(word, task, items)
        # Every now and then the helpers must do all of it: on a busy machine they might else never get to anything.
        while number % 200 != 0:
            item = take_item(word, task)
            if item == NOTHING:
                break
            taken[item] += 1
            item_done(word)
        await_done(word, items)
        for i in range(PARTS):
            wrong += taken[i] != (1 if i < items else 0)
    dismiss(word)
    return wrong


@pytest.mark.parametrize("helpers", [1, 2, 3])
def test_every_item_of_every_task_is_done_once(helpers: int) -> None:
    word, taken = np.zeros(WORDS, np.int64), np.zeros(PARTS, np.int64)
    mine = np.zeros((helpers, 16), np.int64)
    assert lead(word, taken, 0) == 0
    work_until_dismissed(word, taken, mine[0])
    assemble(word)
    threads = [threading.Thread(target=work_until_dismissed, args=(word, taken, own)) for own in mine]
    for thread in threads:
        thread.start()
    assert lead(word, taken, 20_000) == 0
    for thread in threads:
        thread.join()
    assert mine.sum() >= sum(1 + number % PARTS for number in range(0, 20_000, 200))


def test_items_are_taken_in_order_and_then_nothing() -> None:
    word = np.zeros(WORDS, np.int64)
    assert waiting_task(word) == NOTHING
    for number in range(1, 400):
        items = number % (PARTS + 1)
        task, other = (TASK_DISTANCES, TASK_FINGERS) if number % 2 else (TASK_FINGERS, TASK_DISTANCES)
        post(word, task, items)
        for item in range(items):
            assert waiting_task(word) == task
            assert take_item(word, other) == NOTHING
            assert take_item(word, task) == item
        assert waiting_task(word) == NOTHING
        assert take_item(word, task) == NOTHING
        assert word[DONE] == 0
        for _ in range(items):
            item_done(word)
        await_done(word, items)
    dismiss(word)
    assert waiting_task(word) == TASK_STOP
    assert take_item(word, TASK_FINGERS) == take_item(word, TASK_DISTANCES) == NOTHING
    assemble(word)
    assert waiting_task(word) == NOTHING


def test_a_ticket_of_a_task_gone_by_is_not_the_next_ones() -> None:
    word = np.zeros(WORDS, np.int64)
    seen = set()
    for _ in range(100):
        post(word, TASK_FINGERS, 3)
        for item in range(4):
            seen.add(int(word[TICKET]))
            assert take_item(word, TASK_FINGERS) == (item if item < 3 else NOTHING)
        word[DONE] = 3
    assert len(seen) == 400


@given(st.lists(st.integers(0, 10_000), min_size=0, max_size=PARTS))
def test_parts_are_put_in_order_longest_first(costs: list[int]) -> None:
    thread_team = fresh()
    thread_team.part[: len(costs)] = np.arange(len(costs))
    thread_team.cost[: len(costs)] = costs
    sort_parts(thread_team, len(costs))
    assert thread_team.cost[: len(costs)].tolist() == sorted(costs, reverse=True)
    assert [costs[part] for part in thread_team.part[: len(costs)]] == sorted(costs, reverse=True)
    assert sorted(thread_team.part[: len(costs)].tolist()) == list(range(len(costs)))


def test_cpu_time_counts_every_member() -> None:
    thread_team = fresh()
    alone = thread_team_cpu_ns(thread_team)
    assert alone <= thread_cpu_ns()
    own = time.pthread_getcpuclockid(threading.get_ident())
    thread_team.clocks = 2
    thread_team.clock[:2] = own
    before = thread_cpu_ns()
    counted = thread_team_cpu_ns(thread_team)
    assert 3 * before <= counted <= 3 * thread_cpu_ns()
    assert before <= cpu_ns(own) <= thread_cpu_ns()
