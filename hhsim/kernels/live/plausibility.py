"""Plausibility of samples of a glove, and the notes that a compiled loop leaves.

Notes are numbers, of which Python makes lines of text later. Samples are judged before a finger is pushed on.

A joint moves at `JOINT_SPEED` at most: a rapid pinch takes a finger about 90 ms with one peak of speed (Cole & Abbs,
J. Neurophysiol. 55, 1986), and 90° in that time along a minimum-jerk course, whose peak is 15/8 of its mean, is
33 rad/s. A faster joint rests until its new angle has stayed for `CONFIRM`, and then follows at that speed. A finger
whose three joints keep every bit for `STUCK_TIME` while two others move has a stuck sensor. All such fingers are kept
free, since a set point made from a wrong angle pushes where no finger is, until they were plausible for `TRUST`.
"""

import math

import numpy as np

from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.jit import Array, Record, as_int64, jit
from hhsim.kernels.memory import copy_values
from hhsim.kernels.parallel.thread_team import load_acquire, store_release

CAPACITY = 512
"""Number of notes kept; the oldest are overwritten."""

JUMPED = 1
"""Place: finger; value: jump [rad]."""
JUMPED_BACK = 2
JUMP_FOLLOWED = 3
MOVES_AGAIN = 4
STUCK = 5
"""Place: finger; value: duration [s]; count: two others that moved, `8 * first + second`."""
SAFETY_CHANGED = 6
"""Count: new bits."""
MISSED = 7
"""Place: cause; count: number of periods."""
LONG_TICK = 8
REFUSED = 9
"""Unusable sample after a usable one; kept in `LiveArrays.refused`."""
BEGAN_INSIDE = 10
FULL = 11
DRIVER_SILENT = 12
"""Count: age of the driver's last sign of life [ns]."""

NOTES = np.dtype(
    [
        ("written", np.int64, (1,)),
        ("time_ns", np.int64, (CAPACITY,)),
        ("code", np.int64, (CAPACITY,)),
        ("place", np.int64, (CAPACITY,)),
        ("count", np.int64, (CAPACITY,)),
        ("value", np.float64, (CAPACITY,)),
    ],
    align=True,
)
"""Ring of notes with one writer: note k lies at k modulo `CAPACITY`; `written` is the number of all so far."""


@jit
def note(notes: Record, time_ns: int, code: int, place: int, count: int, value: float) -> None:
    """Write a note; its numbers are described at the codes."""
    written = load_acquire(notes.written[:], as_int64(0))
    i = written % CAPACITY
    notes.time_ns[i] = time_ns
    notes.code[i] = code
    notes.place[i] = place
    notes.count[i] = count
    notes.value[i] = value
    store_release(notes.written[:], as_int64(0), written + 1)


JOINT_SPEED = 35.0
"""Largest plausible speed of a joint [rad/s]."""
BURST = 0.005
"""Largest delay of a sample [s]."""
TOGETHER = 0.0005
"""Samples nearer than this [s] came together, and share the time before the first of them."""
CONFIRM = 0.015
"""Time for which a jump must stay at its new angle [s]."""
CONFIRM_SAMPLES = 3
"""Samples in which it must stay, the first one included."""
STUCK_TIME = 2.0
"""Time without the change of a bit after which a sensor is stuck [s]."""
STUCK_TRAVEL = 1.0
"""Least motion of each of two other fingers in that time, the sum of its joints [rad]."""
TRUST = 1.0
"""Time of plausible samples without a break before a doubted finger is no longer kept free [s]."""
PAUSE = 0.1
"""Largest share of `TRUST` that the time between two samples counts for [s]."""
QUIET = 1.0
"""Least time between two notes of a finger's jumps [s]."""
MOST_ANGLE = 2.0 * math.pi

FLEXIONS = 3 * FINGER_COUNT
JOINTS = FLEXIONS + FINGER_COUNT
"""Fifteen flexions, then five abductions."""
_SLACK = JOINT_SPEED * BURST
_TRUST_NS = round(1e9 * TRUST)
_PAUSE_NS = round(1e9 * PAUSE)

WATCH = np.dtype(
    [
        ("always_free", np.int64, (FINGER_COUNT,)),  # fingers whose bend has too small a span
        ("noiseless", np.int64),  # a resting finger keeps every bit
        ("free", np.int64, (FINGER_COUNT,)),  # fingers that must stay free
        ("angles", np.float64, (JOINTS,)),  # of the newest sample [rad]
        ("time_ns", np.int64),  # of the newest sample, -1 before the first
        ("believed", np.float64, (JOINTS,)),  # plausible angles [rad]
        ("reach", np.float64, (JOINTS,)),  # plausible distance from these [rad]: grows with time, shrinks with motion
        ("most_reach", np.float64),
        ("target", np.float64, (JOINTS,)),  # angle that a joint jumped to
        ("pending", np.int64, (JOINTS,)),  # the jump is not yet confirmed
        ("following", np.int64, (JOINTS,)),  # it is, and the joint follows
        ("since_ns", np.int64, (JOINTS,)),  # time of the jump
        ("count", np.int64, (JOINTS,)),  # samples since the jump
        ("doubted", np.int64, (FINGER_COUNT,)),  # fingers with pending or following joints
        ("logged_ns", np.int64, (FINGER_COUNT,)),  # time of the last note of a jump
        ("last", np.float64, (FLEXIONS,)),  # flexions of the sample before
        ("changed_ns", np.int64, (FINGER_COUNT,)),  # time of a finger's last change
        ("travel", np.float64, (FINGER_COUNT,)),  # distance moved by each finger [rad]
        ("travel_then", np.float64, (FINGER_COUNT, FINGER_COUNT)),  # of all (columns) when a finger (row) last changed
        ("stuck", np.int64, (FINGER_COUNT,)),
        ("distrust_ns", np.int64, (FINGER_COUNT,)),  # time of plausible samples still needed
    ],
    align=True,
)
"""State of the watch over a glove's samples; flags are 1 or 0."""


@jit
def begin_watch(watch: Record) -> None:
    """Reset what does not begin with zeros; `always_free` and `noiseless` stay."""
    copy_values(watch.always_free[:], watch.free[:])
    watch.time_ns = -1
    watch.most_reach = _SLACK
    watch.logged_ns[:] = -(10**12)
    watch.last[:] = np.nan
    watch.changed_ns[:] = -1


@jit
def _note_jumps(watch: Record, notes: Record, finger: int, fresh: bool, back: bool, sure: bool, far: float) -> None:
    """Note the jumps of a finger's joints in this sample; `far` is the longest [rad]."""
    now = watch.time_ns
    if fresh and now - watch.logged_ns[finger] >= 1e9 * QUIET:
        note(notes, now, as_int64(JUMPED), finger, as_int64(0), far)
        watch.logged_ns[finger] = now
    quiet = now - watch.logged_ns[finger] < 1e9 * QUIET
    if back and quiet:
        note(notes, now, as_int64(JUMPED_BACK), finger, as_int64(0), 0.0)
    if sure and quiet:
        note(notes, now, as_int64(JUMP_FOLLOWED), finger, as_int64(0), 0.0)


@jit
def _doubt(watch: Record, notes: Record, grown: float) -> None:
    """Judge a sample in which some joint jumped, or is still doubted; `grown` is the growth of the reach [rad]."""
    now = watch.time_ns
    for finger in range(FINGER_COUNT):
        any_fresh = any_back = any_sure = doubted = False
        far = 0.0
        for k in range(4):
            joint = 3 * finger + k if k < 3 else FLEXIONS + finger
            angle = watch.angles[joint]
            distance = abs(angle - watch.believed[joint])
            near = distance <= watch.reach[joint]
            pending, following = watch.pending[joint] == 1, watch.following[joint] == 1
            any_back = any_back or (pending and near)
            pending = pending and not near
            fresh = not near and not pending and not following
            # The confirmation begins anew where a pending joint moved on faster than a joint does.
            if fresh or (pending and abs(angle - watch.target[joint]) > _SLACK + grown):
                watch.since_ns[joint] = now
                watch.count[joint] = 0
            pending = pending or fresh
            if pending or following:
                watch.target[joint] = angle
            if pending:
                watch.count[joint] += 1
            sure = pending and watch.count[joint] >= CONFIRM_SAMPLES and now - watch.since_ns[joint] >= 1e9 * CONFIRM
            pending = pending and not sure
            following = following or sure
            if following:
                step = min(max(angle - watch.believed[joint], -grown), grown)
                watch.believed[joint] += step
                following = watch.believed[joint] != angle
                # A joint that follows at full speed has no reach left.
                watch.reach[joint] = grown - abs(step)
            elif near:
                watch.reach[joint] -= distance
                watch.believed[joint] = angle
            watch.pending[joint], watch.following[joint] = pending, following
            doubted = doubted or pending or following
            any_sure = any_sure or sure
            if fresh:
                any_fresh = True
                far = max(far, distance)
        watch.doubted[finger] = doubted
        _note_jumps(watch, notes, finger, any_fresh, any_back, any_sure, far)


@jit
def _believe(watch: Record, notes: Record, now: int) -> None:
    """Hold joints faster than `JOINT_SPEED`, and doubt their fingers."""
    if watch.time_ns < 0:
        watch.time_ns = now
        copy_values(watch.angles[:], watch.believed[:])
        watch.reach[:] = _SLACK
        return
    step = max(0.0, 1e-9 * (now - watch.time_ns))
    watch.time_ns = now
    grown = JOINT_SPEED * step
    if step >= TOGETHER:
        watch.most_reach = _SLACK + grown
    most = _SLACK if step >= TOGETHER else watch.most_reach
    plain = True
    for joint in range(JOINTS):
        watch.reach[joint] = min(watch.reach[joint], most) + grown
        plain = plain and abs(watch.angles[joint] - watch.believed[joint]) <= watch.reach[joint]
    for finger in range(FINGER_COUNT):
        plain = plain and watch.doubted[finger] == 0
    if not plain:
        _doubt(watch, notes, grown)
        return
    for joint in range(JOINTS):
        watch.reach[joint] -= abs(watch.angles[joint] - watch.believed[joint])
        watch.believed[joint] = watch.angles[joint]


@jit
def _look_for_stuck(watch: Record, notes: Record, now: int) -> None:
    """Find fingers that keep every bit while others move."""
    for finger in range(FINGER_COUNT):
        moved = 0.0
        for k in range(3 * finger, 3 * finger + 3):
            moved += abs(watch.angles[k] - watch.last[k])
            watch.last[k] = watch.angles[k]
        if math.isfinite(moved):
            watch.travel[finger] += moved
        # NaN, of the first sample, is a change.
        if moved != 0.0:
            watch.changed_ns[finger] = now
            if watch.stuck[finger] == 1:
                watch.stuck[finger] = 0
                note(notes, now, as_int64(MOVES_AGAIN), finger, as_int64(0), 0.0)
    for finger in range(FINGER_COUNT):
        if watch.changed_ns[finger] == now:
            copy_values(watch.travel[:], watch.travel_then[finger])
            continue
        still = 1e-9 * (now - watch.changed_ns[finger])
        if watch.stuck[finger] == 1 or still < STUCK_TIME:
            continue
        others = 0
        pair = 0
        for other in range(FINGER_COUNT):
            if watch.travel[other] - watch.travel_then[finger, other] >= STUCK_TRAVEL:
                others += 1
                if others <= 2:
                    pair = 8 * pair + other
        if others >= 2:
            watch.stuck[finger] = 1
            note(notes, now, as_int64(STUCK), finger, pair, still)


@jit
def use_sample(watch: Record, notes: Record, sample: Record, flexion_out: Array, abduction_out: Array) -> bool:
    """Judge a sample (`hhsim.live.device.GLOVE_SAMPLE`), set `watch.free` and write its plausible, finite angles.

    Flexion [rad] has the shape (5, 3), abduction (5,). False if the sample is unusable and nothing was written.
    """
    for finger in range(FINGER_COUNT):
        for k in range(3):
            watch.angles[3 * finger + k] = sample.flexion[finger, k]
        watch.angles[FLEXIONS + finger] = sample.abduction[finger]
    usable = bool(sample.good)
    for joint in range(JOINTS):
        # NaN compares false.
        usable = usable and abs(watch.angles[joint]) <= MOST_ANGLE
    if not usable:
        for finger in range(FINGER_COUNT):
            if watch.distrust_ns[finger] > 0:
                watch.distrust_ns[finger] = _TRUST_NS
        return False
    step = min(max(sample.time_ns - watch.time_ns, 0), _PAUSE_NS)
    _believe(watch, notes, sample.time_ns)
    if watch.noiseless == 0:
        _look_for_stuck(watch, notes, sample.time_ns)
    for finger in range(FINGER_COUNT):
        for k in range(3):
            flexion_out[finger, k] = watch.believed[3 * finger + k]
        abduction_out[finger] = watch.believed[FLEXIONS + finger]
        if watch.doubted[finger] == 1 or watch.stuck[finger] == 1:
            watch.distrust_ns[finger] = _TRUST_NS
        else:
            watch.distrust_ns[finger] = max(0, watch.distrust_ns[finger] - step)
        watch.free[finger] = 1 if watch.always_free[finger] == 1 or watch.distrust_ns[finger] > 0 else 0
    return True
