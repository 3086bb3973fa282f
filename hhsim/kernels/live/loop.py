"""Compiled loop of a session: waits, ticks and records until it is to stop, without the interpreter."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.clock import await_event, monotonic_ns, send_event, sleep_until, thread_cpu_ns
from hhsim.kernels.jit import JIT_ENABLED, jit
from hhsim.kernels.live.accounts import account_waking, measure_miss, name_miss, read_run_delay, read_steal
from hhsim.kernels.live.deadlines import begin_periods, due_time, next_deadline, woken
from hhsim.kernels.live.tick import (
    LiveArrays,
    begin_hand,
    begin_tick,
    command_tick,
    look_for_stop,
    publish_tick,
    waiting_since,
)

if TYPE_CHECKING:
    from hhsim.kernels.tick.block import TickBlock

Bytes = NDArray[np.uint8]

ASKS_PYTHON = 0
"""Outcome of `run_loop`: Python has to solve, by a method that is not compiled."""


@by_reference
class SystemFiles(NamedTuple):
    """System files of the loop."""

    descriptors: NDArray[np.int64]  # of schedstat, /proc/stat, the driver's and the loop's event; -1 for none, (4,)
    line: Bytes  # buffers for the text of the first two
    lines: Bytes
    allowed: NDArray[np.bool_]  # processors whose steal counts, by their numbers
    step: NDArray[np.int64]  # unit of the steal counter [ns], (1,)


def _call_block(typing: Any, address: Any, block: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds = signature.args[1].types
        values = cgutils.unpack_tuple(builder, arguments[1])
        kind = context.call_conv.get_function_type(types.int64, kinds)
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        _, done = context.call_conv.call_function(builder, function, types.int64, kinds, values)
        return done

    return types.int64(types.int64, block), generate


if JIT_ENABLED:
    # Called by its address: a tick is the very code that a replay runs, compiled once.
    _run_block = cast(Callable[[int, "TickBlock"], int], intrinsic(_call_block))

else:

    def _run_block(address: int, block: "TickBlock") -> int:
        return address


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
def _finish(live: LiveArrays, files: SystemFiles, solved: bool, status: int) -> None:
    """Do what follows the solving of a tick."""
    deadlines, misses = live.deadlines[0], live.misses[0]
    command_tick(live, monotonic_ns(), solved, status)
    wake_driver(live, files.descriptors[2], monotonic_ns())
    done = monotonic_ns()
    if deadlines.missed > 0:
        steal = -1
        if measure_miss(misses, deadlines.asked_ns, deadlines.late_ns):
            steal = read_steal(files.descriptors[1], files.lines, files.allowed, files.step[0])
        name_miss(misses, steal)
    publish_tick(live, done, solved)


@jit
def _account(live: LiveArrays, files: SystemFiles) -> None:
    """Read the thread's CPU time and run delay, unless the tick began at once."""
    deadlines = live.deadlines[0]
    if deadlines.at_once == 1:
        return
    delay = read_run_delay(files.descriptors[0], files.line)
    account_waking(live.misses[0], deadlines.woke_ns, deadlines.wakeup_ns, thread_cpu_ns(), delay)


@jit
def run_loop(live: LiveArrays, files: SystemFiles, address: int, block: "TickBlock") -> int:
    """Tick until the loop is to stop (returns `STOP_…`), or Python has to solve (returns `ASKS_PYTHON`).

    Periods begin with the first call. `address` is that of `run_block`'s machine code for the types of `block`, 0 if
    Python solves; `block` has the haptic hand and records of the loop's row. After `ASKS_PYTHON`, in the middle of a
    tick, the next call continues it with `LOOP.solved` and `LOOP.status` set.
    """
    loop, deadlines = live.loop[0], live.deadlines[0]
    if loop.asks == 1:
        loop.asks = 0
        _finish(live, files, loop.solved == 1, loop.status)
    if loop.begun == 0:
        # Not before the call: the interpreter's time for it is no part of a period.
        loop.begun = 1
        begin_periods(deadlines, monotonic_ns())
        _account(live, files)
    while loop.stop[0] == 0:
        await_tick(live, files.descriptors[3])
        look_for_stop(live)
        _account(live, files)
        solved = begin_tick(live)
        status = 0
        if solved and address == 0:
            loop.asks = 1
            return ASKS_PYTHON
        if solved:
            solved = begin_hand(live)
        if solved:
            status = loop.status
            loop.status = 0
            _run_block(address, block)
            block.record.status[0] |= status
            status = block.record.status[0]
        _finish(live, files, solved, status)
    return loop.stop[0]
