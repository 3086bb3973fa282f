"""What a glove says is looked at before a finger is pushed on: fingers that jump, and sensors that are stuck.

A joint moves at `JOINT_SPEED` at most. A rapid pinch takes a finger about 90 ms, with a speed of one peak (Cole & Abbs,
J. Neurophysiol. 55, 1986); 90° in that time along a minimum-jerk course, whose peak is 15/8 of its mean, is 33 rad/s.
What is faster is not believed until it has stayed for `CONFIRM`; the joint rests meanwhile, and then follows at that
speed. A finger whose three joints keep every bit for `STUCK_TIME` while two others move has a sensor that is stuck. All
such fingers are kept free, since a set point made from a wrong angle pushes where nobody is, and stay free until their
samples have been plausible for `TRUST`: the next sample alone lifts no doubt.
"""

import math

import numpy as np

from hhsim.kernels.copy import copy_values
from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.jit import Array, Record, as_int64, jit
from hhsim.kernels.live.notes import JUMP_FOLLOWED, JUMPED, JUMPED_BACK, MOVES_AGAIN, STUCK, note

JOINT_SPEED = 35.0
"""Fastest joint that is believed [rad/s]."""
BURST = 0.005
"""By so much may a sample have been late [s]."""
TOGETHER = 0.0005
"""Samples nearer than this [s] came together, and share the time before the first of them."""
CONFIRM = 0.015
"""How long a jump must stay where it went [s]."""
CONFIRM_SAMPLES = 3
"""In how many samples, the first one included."""
STUCK_TIME = 2.0
"""Without the change of one bit [s]."""
STUCK_TRAVEL = 1.0
"""What each of two other fingers moves in that time, all its joints together [rad]."""
TRUST = 1.0
"""A finger that was doubted is kept free until its samples have been plausible for so long, without a break [s]."""
PAUSE = 0.1
"""The time between two samples counts for so much of that at most [s]."""
QUIET = 1.0
"""A finger's jumps are told once in this time [s]."""
MOST_ANGLE = 2.0 * math.pi

FLEXIONS = 3 * FINGER_COUNT
JOINTS = FLEXIONS + FINGER_COUNT
"""Fifteen flexions, five abductions."""
_SLACK = JOINT_SPEED * BURST
_TRUST_NS = round(1e9 * TRUST)
_PAUSE_NS = round(1e9 * PAUSE)

WATCH = np.dtype(
    [
        ("always_free", np.int64, (FINGER_COUNT,)),
        ("noiseless", np.int64),
        ("free", np.int64, (FINGER_COUNT,)),
        ("angles", np.float64, (JOINTS,)),
        ("time_ns", np.int64),
        ("believed", np.float64, (JOINTS,)),
        ("reach", np.float64, (JOINTS,)),
        ("most_reach", np.float64),
        ("target", np.float64, (JOINTS,)),
        ("pending", np.int64, (JOINTS,)),
        ("following", np.int64, (JOINTS,)),
        ("since_ns", np.int64, (JOINTS,)),
        ("count", np.int64, (JOINTS,)),
        ("doubted", np.int64, (FINGER_COUNT,)),
        ("logged_ns", np.int64, (FINGER_COUNT,)),
        ("not_logged", np.int64, (FINGER_COUNT,)),
        ("last", np.float64, (FLEXIONS,)),
        ("changed_ns", np.int64, (FINGER_COUNT,)),
        ("travel", np.float64, (FINGER_COUNT,)),
        ("travel_then", np.float64, (FINGER_COUNT, FINGER_COUNT)),
        ("stuck", np.int64, (FINGER_COUNT,)),
        ("distrust_ns", np.int64, (FINGER_COUNT,)),
    ],
    align=True,
)
"""What is known of a glove's samples; what is true or not is 1 or 0.

| field | meaning |
|---|---|
| always_free | fingers whose bend says too little |
| noiseless | a finger that rests keeps every bit |
| free | fingers on which nothing may push |
| angles, time_ns | of the newest sample [rad], [ns]; `time_ns` is -1 before the first |
| believed | what is believed of it |
| reach, most_reach | how far each joint may be from that [rad]: it grows with time and shrinks with motion |
| target, pending, following, since_ns, count | of joints that jumped: where to, and since when; believed by now |
| doubted | fingers with such joints |
| logged_ns, not_logged | when a finger's jump was told last, and how many were not told since |
| last, changed_ns, stuck | flexions of the sample before, when a finger changed, and whether its sensor is stuck |
| travel, travel_then | way of each finger [rad], now, and of all (columns) when a finger (row) changed last |
| distrust_ns | for how long a finger's samples have yet to be plausible until something may push on it [ns] |
"""


@jit
def begin_watch(watch: Record) -> None:
    """Nothing is seen yet; `always_free` and `noiseless` are there."""
    copy_values(watch.always_free[:], watch.free[:])
    watch.time_ns = -1
    watch.pending[:] = 0
    watch.following[:] = 0
    watch.doubted[:] = 0
    watch.stuck[:] = 0
    watch.distrust_ns[:] = 0
    watch.count[:] = 0
    watch.reach[:] = 0.0
    watch.most_reach = _SLACK
    watch.logged_ns[:] = -(10**12)
    watch.not_logged[:] = 0
    watch.last[:] = np.nan
    watch.changed_ns[:] = -1
    watch.travel[:] = 0.0
    watch.travel_then[:] = 0.0


@jit
def _finger_of(joint: int) -> int:
    return joint // 3 if joint < FLEXIONS else joint - FLEXIONS


@jit
def _tell_jumps(watch: Record, notes: Record, finger: int, fresh: bool, back: bool, sure: bool, far: float) -> None:
    """Note what became of a finger's joints in this sample; `far` is the longest jump [rad]."""
    now = watch.time_ns
    if fresh:
        if now - watch.logged_ns[finger] < 1e9 * QUIET:
            watch.not_logged[finger] += 1
        else:
            note(notes, now, as_int64(JUMPED), finger, watch.not_logged[finger], far)
            watch.logged_ns[finger] = now
            watch.not_logged[finger] = 0
    quiet = now - watch.logged_ns[finger] < 1e9 * QUIET
    if back and quiet:
        note(notes, now, as_int64(JUMPED_BACK), finger, as_int64(0), 0.0)
    if sure and quiet:
        note(notes, now, as_int64(JUMP_FOLLOWED), finger, as_int64(0), 0.0)


@jit
def _doubt(watch: Record, notes: Record, grown: float) -> None:
    """A sample in which some joint jumped, or is still doubted."""
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
            # A joint that is pending begins anew where it moved on faster than a joint does.
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
                watch.believed[joint] += min(max(angle - watch.believed[joint], -grown), grown)
                following = watch.believed[joint] != angle
                # What was passed on at full speed leaves nothing over.
                watch.reach[joint] = 0.0
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
        _tell_jumps(watch, notes, finger, any_fresh, any_back, any_sure, far)


@jit
def _believe(watch: Record, notes: Record, now: int) -> None:
    """Joints faster than `JOINT_SPEED` are held, and their fingers doubted."""
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
    """Fingers that keep every bit while others move."""
    for finger in range(FINGER_COUNT):
        moved = 0.0
        for k in range(3 * finger, 3 * finger + 3):
            moved += abs(watch.angles[k] - watch.last[k])
            watch.last[k] = watch.angles[k]
        if math.isfinite(moved):
            watch.travel[finger] += moved
        # NaN, before there is a sample to compare with, is a change.
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
    """Look at a sample; `free` then says which fingers are kept free.

    Args:
        watch: Of `WATCH`.
        notes: Where findings are told.
        sample: Of `hhsim.live.device.GLOVE_SAMPLE`.
        flexion_out: What to believe of it [rad], shape (5, 3).
        abduction_out: What to believe of it [rad], shape (5,).

    Returns:
        False where nothing of the sample may be used: nothing is written then. What is written is always finite.
    """
    usable = bool(sample.good)
    for joint in range(JOINTS):
        finger = _finger_of(joint)
        angle = sample.flexion[finger, joint - 3 * finger] if joint < FLEXIONS else sample.abduction[finger]
        # NaN compares false.
        usable = usable and abs(angle) <= MOST_ANGLE
        watch.angles[joint] = angle
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
