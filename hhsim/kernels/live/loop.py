"""Compiled loop of a session: waits, ticks and records until it is to stop, without the interpreter."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.clock import await_event, monotonic_ns, send_event, sleep_until, thread_cpu_ns
from hhsim.kernels.jit import jit
from hhsim.kernels.live.deadlines import (
    account_waking,
    begin_periods,
    due_time,
    measure_miss,
    name_miss,
    next_deadline,
    read_run_delay,
    read_steal,
    woken,
)
from hhsim.kernels.live.tick import (
    Hands,
    LiveArrays,
    WorldTick,
    begin_hand,
    begin_tick,
    command_tick,
    free_with_other,
    give_hands,
    look_for_stop,
    publish_hands,
    take_hands,
    waiting_since,
)
from hhsim.kernels.machine_code import call_code

Bytes = NDArray[np.uint8]
ASKS_PYTHON = 0
"""Outcome of `run_loop`: Python has to solve, by what is not compiled."""
DRIVERS = 3
"""Place of the first driver's event among `SystemFiles.descriptors`."""


@by_reference
class SystemFiles(NamedTuple):
    """System files of the loop."""

    # Of schedstat, /proc/stat, the event of the first hand's samples, and that of each hand's driver; -1 for none.
    descriptors: NDArray[np.int64]
    line: Bytes  # buffers for the text of the first two
    lines: Bytes
    allowed: NDArray[np.bool_]  # processors whose steal counts, by their numbers
    step: NDArray[np.int64]  # unit of the steal counter [ns], (1,)


@jit
def wake_driver(live: LiveArrays, descriptor: int, now: int) -> None:
    """Wake the driver for a command after a sample or a change of safety bits, else once in `wake_ns`."""
    loop = live.loop[0]
    news = loop.arrived_ns >= 0 or loop.safety != loop.told
    if descriptor >= 0 and (news or now - loop.woken_ns >= loop.wake_ns):
        loop.woken_ns = now
        send_event(descriptor)


@jit
def await_tick(live: LiveArrays, descriptor: int) -> None:
    """Sleep until the next tick is due; `descriptor` is of the event that comes with each sample, -1 for none."""
    deadlines = live.deadlines[0]
    aim = next_deadline(deadlines, monotonic_ns())
    now = deadlines.asked_ns
    due = due_time(deadlines, waiting_since(live), now)
    while now < due:
        if due < aim or descriptor < 0:
            sleep_until(due)
        else:
            await_event(descriptor, due)
        now = monotonic_ns()
        due = due_time(deadlines, waiting_since(live), now)
    woken(deadlines, now, due)


@jit
def begin_hands(hands: Hands) -> bool:
    """Take and judge the input of all hands; returns whether there is one to solve for of each."""
    loop, solved = hands[0].loop[0], True
    # The first hand last: its samples set the pace.
    for h in range(len(hands) - 1, -1, -1):
        own = hands[h].loop[0]
        own.stop[0], own.placing[0] = loop.stop[0], loop.placing[0]
        solved = begin_tick(hands[h]) and solved
    for h in range(len(hands) - 1):
        free_with_other(hands[h], hands[h + 1])
        free_with_other(hands[h + 1], hands[h])
    return solved


@jit
def _finish(hands: Hands, files: SystemFiles, world: WorldTick, solved: bool) -> None:
    """Do what follows the solving of a tick."""
    deadlines, misses = hands[0].deadlines[0], hands[0].misses[0]
    for h in range(len(hands)):
        command_tick(hands[h], monotonic_ns(), solved, hands[h].loop[0].status)
        wake_driver(hands[h], files.descriptors[DRIVERS + h], monotonic_ns())
    done = monotonic_ns()
    if deadlines.missed > 0:
        steal = -1
        if measure_miss(misses, deadlines.asked_ns, deadlines.late_ns):
            steal = read_steal(files.descriptors[1], files.lines, files.allowed, files.step[0])
        name_miss(misses, steal)
    publish_hands(hands, world, done, solved)


@jit
def _account(live: LiveArrays, files: SystemFiles) -> None:
    """Read the thread's CPU time and run delay, unless the tick began at once."""
    deadlines = live.deadlines[0]
    if deadlines.at_once == 1:
        return
    delay = read_run_delay(files.descriptors[0], files.line)
    account_waking(live.misses[0], deadlines.woke_ns, deadlines.wakeup_ns, thread_cpu_ns(), delay)


@jit
def run_loop(hands: Hands, files: SystemFiles, world: WorldTick, address: int, block: Any) -> int:
    """Tick until the loop is to stop (returns `STOP_…`), or Python has to solve (returns `ASKS_PYTHON`).

    Periods begin with the first call; all hands have the records of periods and misses in common. `address` is that of
    machine code for the types of `block`, its arguments, such as `run_block`'s; 0 if Python solves. `block` has what
    `world` has. After `ASKS_PYTHON`, in the middle of a tick, the next call continues it with `LOOP.solved` set.
    """
    first = hands[0]
    loop, deadlines = first.loop[0], first.deadlines[0]
    if loop.asks == 1:
        loop.asks = 0
        if loop.solved == 1:
            take_hands(hands, world)
        _finish(hands, files, world, loop.solved == 1)
    if loop.begun == 0:
        # Not before the call: the interpreter's time for it is no part of a period.
        loop.begun = 1
        begin_periods(deadlines, monotonic_ns())
        _account(first, files)
    while loop.stop[0] == 0:
        await_tick(first, files.descriptors[2])
        look_for_stop(first)
        _account(first, files)
        solved = begin_hands(hands)
        if solved:
            give_hands(hands, world)
        if solved and address == 0:
            loop.asks = 1
            return ASKS_PYTHON
        if solved:
            solved = begin_hand(first)
        if solved:
            call_code(address, block)
            take_hands(hands, world)
        _finish(hands, files, world, solved)
    return loop.stop[0]
