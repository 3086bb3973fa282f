"""From the graphic hand to what the fingers are commanded, each tick in place.

A finger is stopped at the bend of the graphic hand, with the configured stiffness while its phalanges carry contact
force, and is free otherwise. Both change no faster than the limits allow, but the stiffness falls at once. Limits count
in ticks and not in time: after missed ticks nothing changes faster. A glove that takes forces is told those on the
phalanges by the share that the stiffness has of the configured one: they come and go with it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand.kinematics import FINGER_COUNT
from hhsim.kernels.jit import Array, Record, jit
from hhsim.kernels.live.interlock import SOLVER_FAILED
from hhsim.kernels.rotation import quaternion_to_matrix

COMMANDER = np.dtype(
    [
        ("configured", np.float64, (FINGER_COUNT,)),
        ("rise", np.float64),
        ("move", np.float64),
        ("fall", np.float64, (FINGER_COUNT,)),
        ("ramp_ticks", np.int64),
        ("feels", np.int64),
        ("contact_force", np.float64),
        ("gain", np.float64, (FINGER_COUNT, 3)),
        ("offset", np.float64, (FINGER_COUNT, 3)),
        ("good_ticks", np.int64),
        ("begun", np.int64),
        ("easing", np.int64),
        ("bend", np.float64, (FINGER_COUNT,)),
        ("stiffness", np.float64, (FINGER_COUNT,)),
        ("force", np.float64, (FINGER_COUNT,)),
        ("phalanx", np.float64, (FINGER_COUNT, 3, 3)),
        ("wanted", np.float64, (FINGER_COUNT,)),
        ("turn", np.float64, (3, 3)),
    ],
    align=True,
)
"""The limits, a tick each, and the command.

| field | meaning |
|---|---|
| configured | stiffness of each finger while it carries force, 0 to 1 |
| rise, fall | most growth of the stiffness, and what it falls by while it is eased |
| move | most change of a set point |
| ramp_ticks | ticks to the full stiffness |
| feels | 1: the glove takes forces, or powers that are made of them |
| contact_force | below it a finger is free [N] |
| gain, offset | a bend is the sum of gain times (angle - offset) |
| good_ticks | ticks without a fault, up to `ramp_ticks` |
| begun, easing | 1: a set point is there; the stiffness is being eased |
| bend, stiffness | the command: where each finger is stopped, 0 (flat) to 1 (fist), and how hard, 0 (free) to 1 |
| force | what the phalanges of each finger feel together in this tick [N] |
| phalanx | the command to a glove that feels: force on each phalanx [N], in the frame of the graphic palm; else 0 |
| wanted, turn | bends of the graphic hand, and the matrix of its palm |
"""


@jit
def free_fingers(commander: Record) -> None:
    """Stiffness and forces 0, and the ramp from the beginning."""
    commander.stiffness[:] = 0.0
    commander.phalanx[:] = 0.0
    commander.good_ticks = 0
    commander.easing = 0


@jit
def ease_fingers(commander: Record) -> None:
    """The ramp from the beginning, and until it is as high as the stiffness, that falls."""
    commander.good_ticks = 0
    commander.easing = 1


@jit
def _measure(commander: Record, flexion: Array, phalanx: Array) -> bool:
    """Bend and force of each finger; False where one is not finite."""
    sum_ = 0.0
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
        sum_ += abs(bend) + force
    return math.isfinite(sum_)


@jit
def _follow(commander: Record) -> None:
    """Move the set points; the first ones have nowhere to come from, and no finger is held yet."""
    for finger in range(FINGER_COUNT):
        wanted = min(max(commander.wanted[finger], 0.0), 1.0)
        if commander.begun == 1:
            before = commander.bend[finger]
            step = min(max(wanted - before, -commander.move), commander.move)
            wanted = min(max(before + step, 0.0), 1.0)
        commander.bend[finger] = wanted
    commander.begun = 1


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
    """The forces in the palm's frame, each finger's by the share that its stiffness has of the configured one."""
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
    commander: Record,
    flexion: Array,
    phalanx: Array,
    orientation: Array,
    safety: int,
    kept_free: NDArray[np.int64],
) -> int:
    """Make the command of a tick.

    Args:
        commander: Of `COMMANDER`.
        flexion: Of the graphic hand [rad], shape (5, 3).
        phalanx: Force on each phalanx [N], shape (5, 3, 3), world.
        orientation: Of the graphic palm, unit (w, x, y, z), shape (4,), world.
        safety: Bits of the tick; any of them frees all fingers.
        kept_free: 1 for fingers on which nothing may push, shape (5,).

    Returns:
        `safety`, with SOLVER_FAILED where an angle or a force is not finite.
    """
    if not _measure(commander, flexion, phalanx):
        commander.force[:] = 0.0
        free_fingers(commander)
        return safety | SOLVER_FAILED
    _follow(commander)
    if safety != 0:
        free_fingers(commander)
        return safety
    commander.good_ticks = min(commander.good_ticks + 1, commander.ramp_ticks)
    _press(commander, kept_free)
    if commander.feels == 1:
        _feel(commander, phalanx, orientation)
    return safety
