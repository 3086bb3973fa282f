"""Threads that share the work of one tick, and the atomic operations that they need.

Atomic operations on elements of contiguous int64 arrays, aligned as numpy's own are.

Values written before `store_release` or `fetch_add` are seen by a thread that has read the new value by `load_acquire`,
`fetch_add` or `compare_exchange`.

Threads that share the programs of the five fingers in one tick.

The tick's own thread posts a task of a few items. It and its helpers, which wait in
`kernels.world.progressive.help_out` for as long as a block of ticks lasts, take one item after another until none is
left. A tick takes some ten
microseconds, so the helpers do not sleep but poll one word of memory: a task costs half a microsecond more than its
longest item.

One 64-bit *ticket* holds the task's number, its number of items and the next one. It is taken by compare-and-exchange,
and every task has a new number, so that a late helper takes nothing. An item writes nothing that another item of its
task reads or writes: results do not depend on who computes what, and when.
"""

import platform
from typing import Any

import numpy as np
from llvmlite import ir

from hhsim.kernels.clock import call_c, cpu_ns, thread_cpu_ns
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.jit import Indices, Record, as_int64, jit, jit_inline, lowered

WORD_BYTES = 8


def _place(builder: Any, array: Any, index: Any) -> Any:
    return builder.gep(array.data, [index])


@lowered(int)
def _load(builder: Any, array: Any, index: Any) -> Any:
    return builder.load_atomic(_place(builder, array, index), "acquire", WORD_BYTES)


@lowered(type(None))
def _store(builder: Any, array: Any, index: Any, value: Any) -> None:
    builder.store_atomic(value, _place(builder, array, index), "release", WORD_BYTES)


@lowered(int)
def fetch_add(builder: Any, array: Any, index: Any, value: Any) -> Any:
    """Add to array[index]; return the value before."""
    return builder.atomic_rmw("add", _place(builder, array, index), value, "acq_rel")


@lowered(bool)
def compare_exchange(builder: Any, array: Any, index: Any, expected: Any, value: Any) -> Any:
    """Set array[index] if it is `expected`; return True if it was."""
    outcome = builder.cmpxchg(_place(builder, array, index), expected, value, "acq_rel", "acquire")
    return builder.extract_value(outcome, 1)


@lowered(type(None))
def pause(builder: Any) -> None:
    """Execute the processor's instruction for a waiting loop."""
    if platform.machine() == "x86_64":
        call_c(builder, "llvm.x86.sse2.pause", ir.VoidType())


@lowered(type(None))
def yield_processor(builder: Any) -> None:
    """Yield the processor to another ready thread."""
    call_c(builder, "sched_yield", ir.IntType(32))


# Python, which can call nothing lowered, calls these two.


@jit_inline
def load_acquire(array: Indices, index: int) -> int:
    """Return array[index]; all that was written before its store is seen."""
    return _load(array, index)


@jit_inline
def store_release(array: Indices, index: int, value: int) -> None:
    """Set array[index]; all that was written before is seen by its readers."""
    _store(array, index, value)


TICKET = 0
DONE = 16
"""Indices of the two shared words, in different cache lines."""
WORDS = 32

ITEM_BITS = 8
ITEM_MASK = (1 << ITEM_BITS) - 1
NUMBER_SHIFT = 2 * ITEM_BITS
"""A ticket is number | items | next item, from its highest bits to its lowest."""
DISMISSAL = (1 << NUMBER_SHIFT) - 1
"""Items and next item of the ticket that ends the helpers."""

NOTHING = -1
DISMISSED = -2
"""Returned in place of an item."""

PATIENCE = 1000
"""Polls of a word, some 60 µs, after which a waiting thread yields its processor between two polls."""

THREAD_TEAM = np.dtype(
    [
        ("members", np.int64),  # threads, the tick's own included; 0 or 1: the tick does everything itself
        ("clocks", np.int64),  # number of helpers
        ("clock", np.int64, (FINGER_COUNT,)),  # CPU clock of each helper as `clock_gettime` knows it
        ("before", np.int64, (DONE,)),  # keeps other data out of the cache lines of `word`, as `behind` does
        ("word", np.int64, (WORDS,)),  # the ticket and the number of items done
        ("behind", np.int64, (DONE,)),
    ],
    align=True,
)
"""Data that a thread team shares."""


@jit
def _post(word: Indices, content: int) -> None:
    """Store a ticket with a new number."""
    number = (word[TICKET] >> NUMBER_SHIFT) + 1
    word[DONE] = 0
    store_release(word, as_int64(TICKET), (number << NUMBER_SHIFT) | content)


@jit
def post(word: Indices, items: int) -> None:
    """Post a task of so many items to the thread team, none to take back a dismissal; the last one is done."""
    _post(word, items << ITEM_BITS)


@jit
def dismiss(word: Indices) -> None:
    """End the helpers."""
    _post(word, as_int64(DISMISSAL))


@jit
def take_item(word: Indices) -> int:
    """Take the next item of the task; NOTHING if none is left, DISMISSED if the thread team is."""
    while True:
        ticket = load_acquire(word, as_int64(TICKET))
        item = ticket & ITEM_MASK
        if item >= (ticket >> ITEM_BITS) & ITEM_MASK:
            return DISMISSED if ticket & DISMISSAL == DISMISSAL else NOTHING
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
