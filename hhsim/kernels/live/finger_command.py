"""Command of the fingers in a live loop, and the reasons for which they must be free.

A finger is stopped at the bend of the graphic hand with the configured stiffness while its phalanges carry contact
force, and is free otherwise. Both change at limited rates, but the stiffness falls at once. Rates are a tick, not a
second: after missed ticks nothing changes faster. Forces for a glove that takes them scale with the stiffness.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.jit import Array, Record, jit
from hhsim.kernels.rotation import quaternion_to_matrix

STALE_INPUT = 1
NOT_FINITE = 2
SOLVER_FAILED = 4
OVERRUN_STREAK = 8
DEVICE_LOST = 16
STOPPING = 32
NO_WATCHDOG = 64
DRY_RUN = 128
NO_INPUT_YET = 256
OTHER_HAND = 512
"""Bits of `hhsim.result.safety.Safety`, whose test compares them."""
FREES_BOTH = STALE_INPUT | NOT_FINITE | SOLVER_FAILED | OVERRUN_STREAK | DEVICE_LOST | NO_WATCHDOG
"""Faults of one hand that free the user's other one, too."""

INTERLOCK = np.dtype(
    [
        ("stale_ns", np.int64),  # age from which on the input is stale
        ("watchdog_ns", np.int64),  # age of its last sign of life from which on the watchdog counts as gone
        ("eased", np.int64),  # periods missed in a row from which on the stiffness is eased
        ("released", np.int64),  # and from which on the fingers are freed
        ("watched", np.int64),  # 1: a watchdog must be there
        ("always", np.int64),  # bits of every tick
        ("streak", np.int64),  # periods missed, or begun late, since the last tick in time
        ("eases", np.int64),  # 1: the stiffness is to be eased
    ],
    align=True,
)
"""Limits and state of the interlock."""


@jit
def judge(
    interlock: Record,
    now: int,
    sample_ns: int,
    pose_ns: int,
    usable: bool,
    missed: int,
    watchdog_ns: int,
    armed: bool,
    lost: bool,
    stopping: bool,
) -> int:
    """Compute the bits of a tick before it is solved; a bit stands as long as its reason does.

    Sample and pose in use came at `sample_ns` and `pose_ns`, -1 before the first; the newest sample may be unusable.
    `missed` counts the periods right before this tick, and one more if it began late, without a sleep. The watchdog's
    last sign of life is 0 before the first; it may be `armed`, that is, reach the glove, which may be `lost`.
    """
    bits = interlock.always
    if sample_ns < 0 or pose_ns < 0:
        bits |= NO_INPUT_YET
    elif now - min(sample_ns, pose_ns) > interlock.stale_ns:
        bits |= STALE_INPUT
    if not usable:
        bits |= NOT_FINITE
    interlock.streak = interlock.streak + missed if missed > 0 else 0
    if interlock.streak >= interlock.released:
        bits |= OVERRUN_STREAK
    interlock.eases = 1 if interlock.streak >= interlock.eased else 0
    if lost:
        bits |= DEVICE_LOST
    if stopping:
        bits |= STOPPING
    if interlock.watched == 1 and (not armed or now - watchdog_ns > interlock.watchdog_ns):
        bits |= NO_WATCHDOG
    return bits


COMMANDER = np.dtype(
    [
        ("configured", np.float64, (FINGER_COUNT,)),  # stiffness of each finger while it carries force, 0 to 1
        ("rise", np.float64),  # largest growth of the stiffness
        ("move", np.float64),  # largest change of a set point
        ("fall", np.float64, (FINGER_COUNT,)),  # decrease of the stiffness while it is eased
        ("ramp_ticks", np.int64),  # ticks to the full stiffness
        ("feels", np.int64),  # 1: the glove takes forces, or powers made of them
        ("contact_force", np.float64),  # least force of a finger that is not free [N]
        ("gain", np.float64, (FINGER_COUNT, 3)),  # a bend is the sum of gain * (angle - offset)
        ("offset", np.float64, (FINGER_COUNT, 3)),
        ("good_ticks", np.int64),  # ticks without a fault, up to `ramp_ticks`
        ("begun", np.int64),  # 1: there is a set point
        ("easing", np.int64),  # 1: the stiffness is being eased
        ("bend", np.float64, (FINGER_COUNT,)),  # command: set point, 0 flat to 1 fist
        ("stiffness", np.float64, (FINGER_COUNT,)),  # command: 0 free to 1
        ("force", np.float64, (FINGER_COUNT,)),  # sum of the forces on a finger's phalanges in this tick [N]
        ("phalanx", np.float64, (FINGER_COUNT, 3, 3)),  # command: force on each phalanx [N], graphic palm frame
        ("wanted", np.float64, (FINGER_COUNT,)),  # bends of the graphic hand
        ("turn", np.float64, (3, 3)),  # rotation matrix of its palm
    ],
    align=True,
)
"""Limits, each per tick, and the command."""


@jit
def free_fingers(commander: Record) -> None:
    """Set stiffness and forces to 0 and restart the ramp."""
    commander.stiffness[:] = 0.0
    commander.phalanx[:] = 0.0
    commander.good_ticks = 0
    commander.easing = 0


@jit
def _press(commander: Record, kept_free: NDArray[np.int64]) -> None:
    share = commander.good_ticks / commander.ramp_ticks
    still = 0
    for finger in range(FINGER_COUNT):
        before = commander.stiffness[finger]
        free = commander.force[finger] < commander.contact_force or kept_free[finger] != 0
        target = 0.0 if free else commander.configured[finger] * share
        now = min(target, before + commander.rise)
        if commander.easing == 1:
            least = 0.0 if free else before - commander.fall[finger]
            if least > now:
                still = 1
                now = least
        commander.stiffness[finger] = now
    commander.easing = still


@jit
def _feel(commander: Record, phalanx: Array, orientation: Array) -> None:
    """Compute the forces in the palm frame, scaled by each finger's share of its configured stiffness."""
    turn = commander.turn[:]
    quaternion_to_matrix(orientation, turn)
    for finger in range(FINGER_COUNT):
        most = commander.configured[finger]
        share = commander.stiffness[finger] / most if most > 0.0 else 0.0
        for joint in range(3):
            for axis in range(3):
                along = 0.0
                for world in range(3):
                    along += phalanx[finger, joint, world] * turn[world, axis]
                commander.phalanx[finger, joint, axis] = along * share


@jit
def update_command(
    commander: Record, flexion: Array, phalanx: Array, orientation: Array, safety: int, kept_free: NDArray[np.int64]
) -> int:
    """Compute the command of a tick, and return `safety`, with SOLVER_FAILED for an angle or force that is not finite.

    Takes the graphic hand's flexion [rad], shape (5, 3), the force on each phalanx [N], shape (5, 3, 3), world, the
    palm's (w, x, y, z), world, the tick's bits, any of which frees all fingers, and 1 for those kept free, shape (5,).
    """
    whole = 0.0
    for finger in range(FINGER_COUNT):
        bend = force = 0.0
        for joint in range(3):
            bend += commander.gain[finger, joint] * (flexion[finger, joint] - commander.offset[finger, joint])
            square = 0.0
            for axis in range(3):
                square += phalanx[finger, joint, axis] * phalanx[finger, joint, axis]
            force += math.sqrt(square)
        commander.wanted[finger] = bend
        commander.force[finger] = force
        whole += abs(bend) + force
    if not math.isfinite(whole):
        commander.force[:] = 0.0
        free_fingers(commander)
        return safety | SOLVER_FAILED
    # Set points move at their limited rate; the first ones are set at once.
    for finger in range(FINGER_COUNT):
        wanted = min(max(commander.wanted[finger], 0.0), 1.0)
        if commander.begun == 1:
            before = commander.bend[finger]
            step = min(max(wanted - before, -commander.move), commander.move)
            wanted = min(max(before + step, 0.0), 1.0)
        commander.bend[finger] = wanted
    commander.begun = 1
    if safety != 0:
        free_fingers(commander)
        return safety
    commander.good_ticks = min(commander.good_ticks + 1, commander.ramp_ticks)
    _press(commander, kept_free)
    if commander.feels == 1:
        _feel(commander, phalanx, orientation)
    return safety
