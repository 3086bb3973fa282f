"""Threads that share the work of one tick, item by item.

The tick's own thread posts a task of a few items. It and its helpers, which wait in `kernels.tick.thread_team_worker`
for as long as a block of ticks lasts, take one item after another until none is left. A tick takes some ten
microseconds, so the helpers do not sleep but poll one word of memory: a task costs half a microsecond more than its
longest item.

One 64-bit *ticket* holds the task, its number of items and the next one. It is taken by compare-and-exchange, and every
task has a new number in it, so that a late helper takes nothing. An item writes nothing that another item of its task
reads or writes: results do not depend on who computes what, and when.
"""

import numpy as np

from hhsim.kernels.clock import cpu_ns, thread_cpu_ns
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.jit import Indices, Record, as_int64, jit
from hhsim.kernels.parallel.atomic import (
    compare_exchange,
    fetch_add,
    load_acquire,
    pause,
    store_release,
    yield_processor,
)

PARTS = FINGER_COUNT + 1
"""Most items of a task, and members of a team: the five fingers and the palm."""

TASK_DISTANCES = 1
TASK_FINGERS = 2
TASK_STOP = 3

TICKET = 0
DONE = 16
"""Indices of the two shared words, in different cache lines."""
WORDS = 32

ITEM_BITS = 8
TASK_BITS = 8
ITEM_MASK = (1 << ITEM_BITS) - 1
TASK_MASK = (1 << TASK_BITS) - 1
NUMBER_SHIFT = 2 * ITEM_BITS + TASK_BITS
"""A ticket is number | task | items | next item, from its highest bits to its lowest."""

NOTHING = -1

PATIENCE = 1000
"""Polls of a word, some 60 µs, after which a waiting thread yields its processor between two polls."""

THREAD_TEAM = np.dtype(
    [
        ("members", np.int64),  # threads, the tick's own included; 0 or 1: the tick does everything itself
        ("worth", np.int64),  # distances outside of the largest part from which detection is shared
        ("clocks", np.int64),  # number of helpers
        ("clock", np.int64, (PARTS,)),  # CPU clock of each helper as `clock_gettime` knows it
        ("parts", np.int64),  # items of the task
        ("part", np.int64, (PARTS,)),  # what each item is: a finger's number or FINGER_COUNT for the palm
        ("cost", np.int64, (PARTS,)),  # estimates by which the parts are put in order, longest first
        ("status", np.int64, (PARTS,)),  # what each part returned
        ("work", np.int64, (PARTS, 3)),  # what each part counted
        ("before", np.int64, (DONE,)),  # keeps other data out of the cache lines of `word`, as `behind` does
        ("word", np.int64, (WORDS,)),  # the ticket and the number of items done
        ("behind", np.int64, (DONE,)),
    ],
    align=True,
)
"""Data that a thread team shares."""


@jit
def sort_parts(thread_team: Record, count: int) -> None:
    """Sort the first `count` parts by cost, longest first, so that the task ends soonest."""
    part, cost = thread_team.part, thread_team.cost
    for i in range(1, count):
        p, c = part[i], cost[i]
        j = i
        while j > 0 and cost[j - 1] < c:
            part[j], cost[j] = part[j - 1], cost[j - 1]
            j -= 1
        part[j], cost[j] = p, c


@jit
def post(word: Indices, task: int, items: int) -> None:
    """Post a task to the thread team; the previous one has been completed."""
    number = (word[TICKET] >> NUMBER_SHIFT) + 1
    word[DONE] = 0
    store_release(word, as_int64(TICKET), (number << NUMBER_SHIFT) | (task << 2 * ITEM_BITS) | (items << ITEM_BITS))


@jit
def dismiss(word: Indices) -> None:
    """End the helpers."""
    post(word, as_int64(TASK_STOP), as_int64(0))


@jit
def assemble(word: Indices) -> None:
    """Take back a dismissal of an earlier thread team."""
    post(word, as_int64(TASK_DISTANCES), as_int64(0))


@jit
def waiting_task(word: Indices) -> int:
    """Return the task that has an item left, TASK_STOP if the thread team is dismissed, or NOTHING."""
    ticket = load_acquire(word, as_int64(TICKET))
    task = (ticket >> 2 * ITEM_BITS) & TASK_MASK
    if task == TASK_STOP or ticket & ITEM_MASK < (ticket >> ITEM_BITS) & ITEM_MASK:
        return task
    return NOTHING


@jit
def take_item(word: Indices, task: int) -> int:
    """Take the next item of a task; NOTHING if none is left or another task is posted."""
    while True:
        ticket = load_acquire(word, as_int64(TICKET))
        item = ticket & ITEM_MASK
        if (ticket >> 2 * ITEM_BITS) & TASK_MASK != task or item >= (ticket >> ITEM_BITS) & ITEM_MASK:
            return NOTHING
        if compare_exchange(word, as_int64(TICKET), ticket, ticket + 1):
            return item


@jit
def item_done(word: Indices) -> None:
    """Report a taken item as done."""
    fetch_add(word, as_int64(DONE), as_int64(1))


@jit
def rest(polls: int) -> None:
    """Wait a moment after a number of polls."""
    if polls < PATIENCE:
        pause()
    else:
        yield_processor()


@jit
def await_done(word: Indices, items: int) -> None:
    """Wait until all items of the task are done."""
    polls = as_int64(0)
    while load_acquire(word, as_int64(DONE)) < items:
        rest(polls)
        polls += 1


@jit
def thread_team_cpu_ns(thread_team: Record) -> int:
    """Return the CPU time of all members [ns], waiting included, by each thread's clock: the process's lags by ms."""
    total = thread_cpu_ns()
    for i in range(thread_team.clocks):
        total += cpu_ns(thread_team.clock[i])
    return total
