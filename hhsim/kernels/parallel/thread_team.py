"""A thread team: threads that share the work of one tick, item by item.

The tick's own thread posts a task of a few items. It and its helpers, which wait in `kernels.tick.thread_team_worker`
for as long as a block of ticks lasts, take one item after another until none is left. A tick takes some ten
microseconds, so the helpers do not sleep: they watch one word of memory, and a task costs half a microsecond more than
its longest share.

One 64-bit *ticket* names the task at hand, how many items it has and which one is next. It is taken by
compare-and-exchange, and every task has a new number in it, so that a helper which comes too late takes nothing. An
item writes nothing that another item of its task reads or writes; what comes out is therefore the same whoever does
what, and when.
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
"""Items of the longest task: the five fingers and the palm. More members than that would find nothing to do."""

TASK_DISTANCES = 1
TASK_FINGERS = 2
TASK_STOP = 3

TICKET = 0
DONE = 16
"""Places of the two words that the threads share, far enough apart not to lie in one cache line."""
WORDS = 32

ITEM_BITS = 8
TASK_BITS = 8
ITEM_MASK = (1 << ITEM_BITS) - 1
TASK_MASK = (1 << TASK_BITS) - 1
NUMBER_SHIFT = 2 * ITEM_BITS + TASK_BITS
"""A ticket is number | task | items | next item, from its highest bits to its lowest."""

NOTHING = -1

PATIENCE = 1000
"""Looks at a word, some 60 µs, before a thread that waits lets others have its processor between two looks."""

THREAD_TEAM = np.dtype(
    [
        ("members", np.int64),
        ("worth", np.int64),
        ("clocks", np.int64),
        ("clock", np.int64, (PARTS,)),
        ("parts", np.int64),
        ("part", np.int64, (PARTS,)),
        ("cost", np.int64, (PARTS,)),
        ("status", np.int64, (PARTS,)),
        ("work", np.int64, (PARTS, 3)),
        ("before", np.int64, (DONE,)),
        ("word", np.int64, (WORDS,)),
        ("behind", np.int64, (DONE,)),
    ],
    align=True,
)
"""What a thread team shares.

| field | meaning |
|---|---|
| members | threads, the tick's own included; 0 or 1: the tick does everything itself |
| worth | distances outside of the largest part from which on detection is shared |
| clocks, clock | how many helpers there are, and the CPU clock of each as `clock_gettime` knows it |
| parts, part | of the task at hand: how many items, and what each is, a finger's number or FINGER_COUNT for the palm |
| cost | estimates by which the parts are put in order, longest first |
| status, work | what each part returned and counted |
| word | the ticket and the number of items done |
| before, behind | keep other data out of their cache lines |
"""


@jit
def sort_parts(thread_team: Record, count: int) -> None:
    """Put the first `count` parts in order of their cost, longest first: the last to end then ends soonest."""
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
    """Let the thread team begin with a task; the one before has been completed."""
    number = (word[TICKET] >> NUMBER_SHIFT) + 1
    word[DONE] = 0
    store_release(word, as_int64(TICKET), (number << NUMBER_SHIFT) | (task << 2 * ITEM_BITS) | (items << ITEM_BITS))


@jit
def dismiss(word: Indices) -> None:
    """Send the helpers home."""
    post(word, as_int64(TASK_STOP), as_int64(0))


@jit
def assemble(word: Indices) -> None:
    """Take back what sent an earlier thread team home."""
    post(word, as_int64(TASK_DISTANCES), as_int64(0))


@jit
def waiting_task(word: Indices) -> int:
    """The task that has an item left, TASK_STOP where the thread team is dismissed, or NOTHING."""
    ticket = load_acquire(word, as_int64(TICKET))
    task = (ticket >> 2 * ITEM_BITS) & TASK_MASK
    if task == TASK_STOP or ticket & ITEM_MASK < (ticket >> ITEM_BITS) & ITEM_MASK:
        return task
    return NOTHING


@jit
def take_item(word: Indices, task: int) -> int:
    """The next item of a task, or NOTHING where none is left or the task at hand is another one."""
    while True:
        ticket = load_acquire(word, as_int64(TICKET))
        item = ticket & ITEM_MASK
        if (ticket >> 2 * ITEM_BITS) & TASK_MASK != task or item >= (ticket >> ITEM_BITS) & ITEM_MASK:
            return NOTHING
        if compare_exchange(word, as_int64(TICKET), ticket, ticket + 1):
            return item


@jit
def item_done(word: Indices) -> None:
    """Report an item that was taken as done."""
    fetch_add(word, as_int64(DONE), as_int64(1))


@jit
def rest(looks: int) -> None:
    """Wait a moment after `looks` looks in vain."""
    if looks < PATIENCE:
        pause()
    else:
        yield_processor()


@jit
def await_done(word: Indices, items: int) -> None:
    """Wait until all items of the task are done."""
    looks = as_int64(0)
    while load_acquire(word, as_int64(DONE)) < items:
        rest(looks)
        looks += 1


@jit
def thread_team_cpu_ns(thread_team: Record) -> int:
    """CPU time of all members [ns], waiting for work included.

    Each thread's own clock is read: the process's lags behind, by up to some milliseconds, what other threads take.
    """
    total = thread_cpu_ns()
    for i in range(thread_team.clocks):
        total += cpu_ns(thread_team.clock[i])
    return total
