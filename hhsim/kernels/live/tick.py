"""Tick of the loop: reads and judges samples, commands the fingers and records, without allocating.

The processes of a session share records without a lock: the command, and the palm's pose that the driver writes, have a
version that is odd while they are being written.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.jit import Indices, as_int64, jit
from hhsim.kernels.live.deadlines import CAUSES, NOTHING, count_phase, deadline_shift
from hhsim.kernels.live.finger_command import (
    DEVICE_LOST,
    DRY_RUN,
    FREES_BOTH,
    NOT_FINITE,
    OTHER_HAND,
    OVERRUN_STREAK,
    SOLVER_FAILED,
    free_fingers,
    judge,
    update_command,
)
from hhsim.kernels.live.plausibility import (
    BEGAN_INSIDE,
    DRIVER_SILENT,
    FULL,
    LONG_TICK,
    MISSED,
    REFUSED,
    SAFETY_CHANGED,
    note,
    use_sample,
)
from hhsim.kernels.memory import copy_values
from hhsim.kernels.parallel.thread_team import fetch_add, load_acquire, store_release
from hhsim.kernels.tick.block import HapticBlock, TickRecord
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED, STATUS_INPUT_INVALID, STATUS_START_INSIDE, WORK_TOUCHING

MOST_SAMPLES = 64
"""Most samples used in one tick; the others wait for the next one."""
SOON = 1.5
"""Interval below which a glove has a sample for each tick [periods]."""
INTERVAL_STEP = 1.05
"""Factor by which a glove's usual interval moves towards each one, so that it is their running median."""

LOOP = np.dtype(
    [
        ("stop", np.int64, (1,)),  # `STOP_…`: the next tick is the last one
        ("begun", np.int64),  # 1: the periods have begun
        ("placing", np.int64, (1,)),  # how far the shown hand is placed at its beginning, `NO_HAND` to `BEGUN`
        ("periods", np.int64),  # after which the loop ends by itself, -1: never
        ("longest_ns", np.int64),  # a longer tick has judged what no longer holds
        ("driver_ns", np.int64),  # silence after which the driver counts as gone
        ("taken", np.int64),  # number of samples taken from their ring
        ("palm_seen", np.int64),  # version of the palm's pose in use
        ("sample_ns", np.int64),  # arrival of the sample in use, -1 before the first
        ("pose_ns", np.int64),  # arrival of the pose in use, -1 before the first
        ("input_seq", np.int64),  # number of the sample in use, -1 before the first
        ("usable", np.int64),  # 1: the newest sample can be used
        ("arrived_ns", np.int64),  # arrival of the newest of this tick's samples, -1 without any
        ("usual_ns", np.float64),  # usual interval of the glove's samples, 0 before there are two
        ("asks", np.int64),  # 1: Python solves this tick
        ("solved", np.int64),  # 1: it did
        ("status", np.int64),  # status bits of the solved tick
        ("placed", np.int64),  # status bits of who placed the hand, for its first tick
        ("safety", np.int64),  # bits of this tick
        ("told", np.int64),  # bits of the last note
        ("latency_ns", np.int64),  # from `arrived_ns` to the command, -1 without one
        ("wake_ns", np.int64),  # interval in which the driver is woken for commands without news
        ("woken_ns", np.int64),  # when it was woken last
    ],
    align=True,
)
"""State and limits of the loop; times in ns."""

STOP_ASKED, STOP_DURATION, STOP_SIGNAL = 1, 2, 3

NO_HAND, PLACING, PLACED, NOT_PLACED, BEGUN = 0, 1, 2, 3, 4
"""No hand is known; another thread places the shown hand where it can begin; it is placed; that failed; ticks go on.
Until its first tick the user's hand is kept as it was, so that a replay begins with the same."""


@by_reference
class LiveArrays(NamedTuple):
    """Arrays that a tick of the loop reads and writes: records of shape (1,) but for the rings."""

    loop: Any  # this and the next seven: of the types of those names in `hhsim.kernels.live`
    deadlines: Any
    phase: Any
    interlock: Any
    commander: Any
    watch: Any
    misses: Any
    notes: Any
    refused: Any  # a glove's unusable sample
    status: Any  # the session's, of `hhsim.live.processes.LIVE_STATUS`
    row: Any  # of the tick
    ticks: Any  # ring of such rows
    ticks_written: Indices
    samples: Any  # ring of the glove's samples
    samples_written: Indices


@by_reference
class WorldTick(NamedTuple):
    """A tick of all hands and bodies as the solver's machine code reads and writes it, and the ring of bodies."""

    haptic: HapticBlock  # with the hand as the first axis, each of one tick
    record: TickRecord
    bodies: NDArray[np.uint8]  # the row of the bodies' `WorldRecord`, (bytes,)
    rows: NDArray[np.uint8]  # ring of such rows, which are numbered as those of the ticks, (rows, bytes)


Hands = tuple[LiveArrays, ...]
"""One hand, or the right and the left one."""


@jit
def give_hands(hands: Hands, world: WorldTick) -> None:
    """Copy the users' hands of the loop's rows to the tick that is to be solved."""
    haptic = world.haptic
    for h in range(len(hands)):
        row = hands[h].row[0]
        copy_values(row.haptic_position[:], haptic.position[h, 0])
        copy_values(row.haptic_orientation[:], haptic.orientation[h, 0])
        copy_values(row.haptic_flexion[:], haptic.flexion[h, 0])
        copy_values(row.haptic_abduction[:], haptic.abduction[h, 0])


@jit
def take_hands(hands: Hands, world: WorldTick) -> None:
    """Copy the solved tick to the loop's rows, with the status bits of who placed each hand."""
    record = world.record
    for h in range(len(hands)):
        loop, row = hands[h].loop[0], hands[h].row[0]
        row.status = record.status[h, 0] | loop.placed
        loop.placed = 0
        loop.status = row.status
        copy_values(record.position[h, 0], row.position[:])
        copy_values(record.orientation[h, 0], row.orientation[:])
        copy_values(record.flexion[h, 0], row.flexion[:])
        copy_values(record.abduction[h, 0], row.abduction[:])
        copy_values(record.joints[h, 0], row.joints[:])
        copy_values(record.phalanx[h, 0], row.phalanx[:])
        copy_values(record.fingertip_normal[h, 0], row.fingertip_normal[:])
        copy_values(record.palm_wrench[h, 0], row.palm_wrench[:])
        copy_values(record.total[h, 0], row.total[:])
        copy_values(record.duration[h, 0], row.duration[:])
        row.duration_total = record.duration_total[h, 0]
        row.duration_cpu = record.duration_cpu[h, 0]
        copy_values(record.work[h, 0], row.work[:])
        row.lag = record.lag[h, 0]


@jit
def look_for_stop(live: LiveArrays) -> None:
    """Set `stop` if the command, or the session's duration, ends the loop."""
    loop = live.loop[0]
    if loop.stop[0] != 0:
        return
    if live.status[0].stop_requested != 0:
        loop.stop[0] = STOP_ASKED
    elif loop.periods >= 0 and live.deadlines[0].tick + 1 >= loop.periods:
        loop.stop[0] = STOP_DURATION


@jit
def usual_interval(usual: float, step: int) -> float:
    """Update the running median of a glove's intervals [ns], 0 before the first, by one more; a pause counts."""
    if step <= 0:
        return usual
    if usual == 0.0:
        return float(step)
    if step > usual:
        return usual * INTERVAL_STEP
    return max(usual / INTERVAL_STEP, float(step))


@jit
def waiting_since(live: LiveArrays) -> int:
    """Return when the sample was handed over that the next tick begins with [ns], or `NOTHING`.

    With a sample for each tick, one that missed its tick waits for the deadline: else every following sample would miss
    its tick too.
    """
    loop, deadlines = live.loop[0], live.deadlines[0]
    written = load_acquire(live.samples_written, as_int64(0))
    if written == loop.taken or load_acquire(loop.placing[:], as_int64(0)) not in (NO_HAND, BEGUN):
        return as_int64(NOTHING)
    handed = live.samples[(written - 1) % live.samples.shape[0]].handed_ns
    another = 0.0 < loop.usual_ns < SOON * float(deadlines.period_ns)
    missed_its_tick = handed < deadlines.aim_ns - deadlines.period_ns
    return as_int64(NOTHING) if another and missed_its_tick else handed


@jit
def _take_samples(live: LiveArrays) -> None:
    """Use the samples in the driver's ring since the tick before, oldest first."""
    loop = live.loop[0]
    loop.arrived_ns = -1
    written = load_acquire(live.samples_written, as_int64(0))
    capacity = live.samples.shape[0]
    # Older samples may be overwritten while they are read.
    loop.taken = max(loop.taken, written - capacity // 2)
    last = min(written, loop.taken + MOST_SAMPLES)
    row, status, refused = live.row[0], live.status[0], live.refused[0]
    for number in range(loop.taken, last):
        sample = live.samples[number % capacity]
        loop.arrived_ns = sample.time_ns
        usable = use_sample(live.watch[0], live.notes[0], sample, row.haptic_flexion[:], row.haptic_abduction[:])
        if usable:
            if loop.sample_ns >= 0:
                loop.usual_ns = usual_interval(loop.usual_ns, sample.time_ns - loop.sample_ns)
            loop.sample_ns = status.sample_ns = sample.time_ns
            loop.input_seq = sample.seq
            for i in range(sample.channels.shape[0]):
                refused.known[i] = np.isfinite(sample.channels[i])
        elif loop.usable == 1:
            for i in range(sample.channels.shape[0]):
                refused.channels[i] = sample.channels[i]
            note(live.notes[0], sample.time_ns, as_int64(REFUSED), as_int64(0), as_int64(0), 0.0)
        loop.usable = 1 if usable else 0
        status.battery = sample.battery
    loop.taken = last


@jit
def _take_palm(live: LiveArrays) -> None:
    """Use the newest pose of the palm; one being written waits for the next tick."""
    loop, status, row = live.loop[0], live.status[0], live.row[0]
    version = load_acquire(status.palm_version[:], as_int64(0))
    if version % 2 == 1 or version == loop.palm_seen:
        return
    kept = row.haptic_position[0], row.haptic_position[1], row.haptic_position[2]
    turn = row.haptic_orientation[0], row.haptic_orientation[1], row.haptic_orientation[2], row.haptic_orientation[3]
    copy_values(status.palm_position[:], row.haptic_position[:])
    copy_values(status.palm_orientation[:], row.haptic_orientation[:])
    came = status.palm_ns
    if fetch_add(status.palm_version[:], as_int64(0), as_int64(0)) == version:
        loop.palm_seen = version
        loop.pose_ns = came
        return
    for i in range(3):
        row.haptic_position[i] = kept[i]
    for i in range(4):
        row.haptic_orientation[i] = turn[i]


@jit
def begin_tick(live: LiveArrays) -> bool:
    """Take and judge the input after waking; returns whether there is a hand to solve for."""
    loop, status, deadlines = live.loop[0], live.status[0], live.deadlines[0]
    now = deadlines.woke_ns
    status.heartbeat_ns = now
    if load_acquire(loop.placing[:], as_int64(0)) in (NO_HAND, BEGUN):
        _take_samples(live)
        _take_palm(live)
    else:
        loop.arrived_ns = -1
    if loop.arrived_ns >= 0:
        newest = live.samples[(loop.taken - 1) % live.samples.shape[0]]
        count_phase(live.phase[0], newest.handed_ns, deadlines.period_ns)
    deadlines.shift_ns = deadline_shift(live.phase[0], deadlines.deadline_ns, deadlines.period_ns, loop.usual_ns)
    silent = now - status.driver_ns
    lost = status.device_lost != 0
    if silent > loop.driver_ns and not lost:
        lost = True
        if loop.told & DEVICE_LOST == 0:
            note(live.notes[0], now, as_int64(DRIVER_SILENT), as_int64(0), silent, 0.0)
    loop.safety = judge(
        live.interlock[0],
        now,
        loop.sample_ns,
        loop.pose_ns,
        loop.usable == 1,
        deadlines.missed + deadlines.at_once,
        status.watchdog_ns,
        status.watchdog_armed != 0,
        lost,
        loop.stop[0] != 0,
    )
    return loop.sample_ns >= 0 and loop.pose_ns >= 0


@jit
def free_with_other(live: LiveArrays, other: LiveArrays) -> None:
    """Keep the fingers free in a tick in which a fault frees those of the user's other hand, or did in the one before.

    What the solving of a tick shows is known to the other hand in the next one.
    """
    if (other.loop[0].safety | other.loop[0].told) & FREES_BOTH != 0:
        live.loop[0].safety |= OTHER_HAND


@jit
def begin_hand(live: LiveArrays) -> bool:
    """Return whether the shown hand is placed; else have another thread place it, which may take many periods."""
    loop = live.loop[0]
    placing = load_acquire(loop.placing[:], as_int64(0))
    if placing == BEGUN:
        return True
    if placing == NO_HAND:
        loop.arrived_ns = -1
        store_release(loop.placing[:], as_int64(0), as_int64(PLACING))
    elif placing != PLACING:
        loop.placing[0] = BEGUN
        if placing == NOT_PLACED:
            loop.safety |= SOLVER_FAILED
            return False
        loop.arrived_ns = loop.sample_ns
        return True
    return False


@jit
def command_tick(live: LiveArrays, now: int, solved: bool, status: int) -> None:
    """Compute and hand over the command of a tick, solved by `now` [ns] or not, with the solver's status bits."""
    loop, row, commander = live.loop[0], live.row[0], live.commander[0]
    woke = live.deadlines[0].woke_ns
    if solved:
        if status & STATUS_CAPACITY_EXCEEDED:
            note(live.notes[0], woke, as_int64(FULL), as_int64(0), as_int64(0), 0.0)
            loop.safety |= SOLVER_FAILED
        if status & STATUS_INPUT_INVALID:
            loop.safety |= NOT_FINITE
        if status & STATUS_START_INSIDE:
            note(live.notes[0], woke, as_int64(BEGAN_INSIDE), as_int64(0), as_int64(0), 0.0)
        if live.interlock[0].eases == 1:
            # The ramp begins anew, and the stiffness falls until it meets it.
            commander.good_ticks = 0
            commander.easing = 1
        loop.safety = update_command(
            commander, row.flexion[:], row.phalanx[:], row.orientation[:], loop.safety, live.watch[0].free[:]
        )
    if now - woke >= loop.longest_ns:
        # The judgement of the tick's beginning may no longer hold.
        loop.safety |= OVERRUN_STREAK
        note(live.notes[0], woke, as_int64(LONG_TICK), as_int64(0), as_int64(0), 0.0)
    if loop.safety != 0 or not solved:
        free_fingers(commander)
    # The driver reads the command from the status.
    shared = live.status[0]
    version = shared.command_version[:]
    fetch_add(version, as_int64(0), as_int64(1))
    copy_values(commander.bend[:], shared.command_bend[:])
    copy_values(commander.stiffness[:], shared.command_stiffness[:])
    for finger in range(commander.phalanx.shape[0]):
        for joint in range(commander.phalanx.shape[1]):
            copy_values(commander.phalanx[finger, joint], shared.command_force[finger, joint])
    shared.command_safety = loop.safety
    fetch_add(version, as_int64(0), as_int64(1))


@jit
def _publish_tick(live: LiveArrays, done: int, solved: bool) -> None:
    """Record a tick whose command was handed over at `done` [ns], unless there is no graphic hand (`solved`)."""
    loop, status, deadlines = live.loop[0], live.status[0], live.deadlines[0]
    sent = loop.safety & DRY_RUN != 0 or loop.safety & DEVICE_LOST == 0
    loop.latency_ns = done - loop.arrived_ns if sent and loop.arrived_ns >= 0 else -1
    if deadlines.missed > 0:
        cause = live.misses[0].cause
        status.missed_by[min(max(cause, 1), CAUSES) - 1] += deadlines.missed
        note(live.notes[0], deadlines.woke_ns, as_int64(MISSED), cause, deadlines.missed, 0.0)
    if solved:
        row, commander = live.row[0], live.commander[0]
        row.tick = deadlines.tick
        row.time_ns = deadlines.deadline_ns - deadlines.early_ns
        row.early_ns = deadlines.early_ns
        row.wakeup_ns = deadlines.late_ns
        row.latency_ns = loop.latency_ns
        row.missed = deadlines.missed
        row.at_once = deadlines.at_once
        row.input_seq = loop.input_seq
        row.safety = loop.safety
        row.cause = 0
        row.taken[:] = 0
        if deadlines.missed > 0:
            row.cause = live.misses[0].cause
            copy_values(live.misses[0].taken[:], row.taken[:])
        copy_values(commander.bend[:], row.command_bend[:])
        copy_values(commander.stiffness[:], row.command_stiffness[:])
        written = live.ticks_written[0]
        live.ticks[written % live.ticks.shape[0]] = row
        store_release(live.ticks_written, as_int64(0), written + 1)
    status.ticks += 1
    status.missed = deadlines.missed_total
    status.safety = loop.safety
    status.contacts = live.row[0].work[WORK_TOUCHING]
    copy_values(live.commander[0].force[:], status.force[:])
    if loop.safety != loop.told:
        note(live.notes[0], deadlines.woke_ns, as_int64(SAFETY_CHANGED), as_int64(0), loop.safety, 0.0)
        loop.told = loop.safety


@jit
def publish_hands(hands: Hands, world: WorldTick, done: int, solved: bool) -> None:
    """Record a tick, see `_publish_tick`; the first hand last, so that who reads its row finds all the others."""
    if solved:
        # It comes before the first hand's own row, by which it is found.
        copy_values(world.bodies, world.rows[hands[0].ticks_written[0] % world.rows.shape[0]])
    for h in range(len(hands) - 1, -1, -1):
        _publish_tick(hands[h], done, solved)
