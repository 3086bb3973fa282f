"""Motion of a closed hand during the phases of a script: carried with the object, or taking the object along.

In a `carry` hand and object move together. In a lift, a shake and a turn the hand alone is commanded; a free object
follows as friction has it.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion
from hhsim.motion.object_motion import RigidMotion
from hhsim.scene.script import Script, ScriptPhase

END = 1e-9
"""A sample this near to the end of a phase, as a share of its duration, is at the end."""
UPRIGHT = 0.5
"""An axis whose level part is shorter than this share of it gives no direction on a table."""


def minimum_jerk(share: ArrayLike) -> FloatArray:
    """Return 10τ³ − 15τ⁴ + 6τ⁵ for τ in [0, 1], 0 before and 1 after: no jumps in speed and acceleration."""
    tau = np.clip(np.asarray(share, dtype=np.float64), 0.0, 1.0)
    return np.asarray(tau**3 * (10.0 + tau * (6.0 * tau - 15.0)))


def to_and_fro(share: ArrayLike, cycles: float) -> FloatArray:
    """Return sin²(πτ) sin(2πnτ) for τ in [0, 1] and n cycles, else 0: an oscillation that starts and ends at rest."""
    tau = np.clip(np.asarray(share, dtype=np.float64), 0.0, 1.0)
    return np.asarray(np.sin(np.pi * tau) ** 2 * np.sin(2.0 * np.pi * cycles * tau))


def phase_shares(script: Script, time: FloatArray) -> Iterator[tuple[ScriptPhase, float, FloatArray]]:
    """Yield each phase, its start [s], and its share that is over at each sample: below 0 before, above 1 after it.

    A sample at the end of a phase has a share of exactly 1, whatever rounding makes of its stamp: a hold stands still.
    """
    start = 0.0
    for phase in script.phases:
        share = (time - start) / phase.duration
        share[np.abs(share - 1.0) < END] = 1.0
        yield phase, start, np.asarray(share)
        start += phase.duration


def carried(script: Script, time: FloatArray, start: FloatArray) -> RigidMotion | None:
    """Compute the common motion of hand and object in the carries of a script; None without a carry.

    `time` [s] has shape (T,); `start` is the origin of the object before the first arc [m], shape (3,).
    """
    if not script.carries:
        return None
    heading, zeros, place = np.zeros(len(time)), np.zeros(len(time)), np.tile(start, (len(time), 1))
    for phase, _, share in phase_shares(script, time):
        if phase.name == "carry":
            # Every later sample stands at the end of the arc, until another arc goes on from there.
            first, turned = heading[-1], phase.turn * minimum_jerk(share)
            # Chord and middle heading of the arc so far; sinc(x) is sin(πx)/(πx), finite on a straight line.
            chord = phase.distance * minimum_jerk(share) * np.sinc(0.5 * turned / np.pi)
            along = first + 0.5 * turned
            place = place + chord[:, None] * np.stack([np.cos(along), np.sin(along), zeros], axis=1)
            heading = heading + turned
    return _about(np.stack([zeros, zeros, heading], axis=1), np.broadcast_to(start, place.shape), place)


def taken_along(script: Script, time: FloatArray, rotation: FloatArray, middle: FloatArray) -> RigidMotion | None:
    """Compute the motion of the hand in the lifts, shakes and turns of a script; None without any.

    A lift goes straight up, a shake goes across the palm, and a turn is about the direction of the fingers through the
    object's middle; the last two directions are made level.

    Args:
        rotation: Closed hand, palm to world, shape (3, 3).
        middle: Middle of the object at rest [m], shape (3,).
    """
    if not script.takes_along:
        return None
    across, ahead = level(rotation[:, 0], rotation[:, 1]), level(rotation[:, 1], rotation[:, 0])
    place, angle = np.tile(middle, (len(time), 1)), np.zeros(len(time))
    for phase, _, share in phase_shares(script, time):
        if phase.name == "lift":
            place = place + (phase.distance * minimum_jerk(share))[:, None] * [0.0, 0.0, 1.0]
        elif phase.name == "shake":
            place = place + (phase.distance * to_and_fro(share, phase.cycles))[:, None] * across
        elif phase.name == "turn":
            angle = angle + phase.turn * minimum_jerk(share)
    return _about(angle[:, None] * ahead, np.broadcast_to(middle, place.shape), place)


def level(direction: FloatArray, otherwise: FloatArray) -> FloatArray:
    """Return the unit vector along the level part of a direction, or of another one if it is upright; shape (3,)."""
    for axis in (direction, otherwise):
        flat = np.array([axis[0], axis[1], 0.0])
        length = float(np.linalg.norm(flat))
        if length >= UPRIGHT * float(np.linalg.norm(axis)) and length > 0.0:
            return flat / length
    return np.array([1.0, 0.0, 0.0])


def _about(angle: FloatArray, pivot: FloatArray, place: FloatArray) -> RigidMotion:
    """Rotation by vectors [rad] about a pivot that moves to a place; one row a sample."""
    turn = quaternion(angle)
    return RigidMotion(turn, place - RigidMotion(turn, np.zeros_like(place)).points(np.ascontiguousarray(pivot)))
