"""How the phases of a script move the closed hand through the world: carried with the object, or taking it along.

In a `carry` hand and object go together, as a recording of both would have it. In a lift, a shake and a turn the hand
alone is told to go, and what it holds comes along as friction has it, where the object is free.
"""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.quaternion import quaternion
from hhsim.motion.object_motion import RigidMotion
from hhsim.scene.script import Script

END = 1e-9
"""A sample this near to the end of a phase, as a share of its duration, is at it."""
UPRIGHT = 0.5
"""An axis of the palm whose level part is shorter than this is no direction on a table."""


def minimum_jerk(share: ArrayLike) -> FloatArray:
    """10τ³ − 15τ⁴ + 6τ⁵ for τ in [0, 1], 0 before and 1 after: position without jumps in speed and acceleration."""
    tau = np.clip(np.asarray(share, dtype=np.float64), 0.0, 1.0)
    return np.asarray(tau**3 * (10.0 + tau * (6.0 * tau - 15.0)))


def to_and_fro(share: ArrayLike, cycles: float) -> FloatArray:
    """sin²(πτ) sin(2πnτ) for τ in [0, 1] and n cycles, else 0: swings that grow from rest and end at rest."""
    tau = np.clip(np.asarray(share, dtype=np.float64), 0.0, 1.0)
    return np.asarray(np.sin(np.pi * tau) ** 2 * np.sin(2.0 * np.pi * cycles * tau))


def phase_share(time: FloatArray, start: float, duration: float) -> FloatArray:
    """Of a phase, at each sample: below 0 before it, above 1 after it.

    A sample at its end has arrived, whatever rounding makes of its stamp: a hold stands still.
    """
    share = (time - start) / duration
    share[np.abs(share - 1.0) < END] = 1.0
    return np.asarray(share)


def carried(script: Script, time: FloatArray, start: FloatArray) -> RigidMotion | None:
    """How a script carries hand and object about at each sample; None where it does not.

    Args:
        script: What the hand does.
        time: Of the samples [s], shape (T,).
        start: The object's origin, where the first arc begins [m], shape (3,).
    """
    if not any(phase.name == "carry" for phase in script.phases):
        return None
    heading, place = np.zeros(len(time)), np.tile(start, (len(time), 1))
    begin = 0.0
    for phase in script.phases:
        if phase.name == "carry":
            share = phase_share(time, begin, phase.duration)
            # Every later sample stands at the end of the arc, until another arc goes on from there.
            first, turned = heading[-1], phase.turn * minimum_jerk(share)
            # Chord and middle heading of the arc so far; sinc(x) is sin(πx)/(πx), and whole where the way is straight.
            chord = phase.distance * minimum_jerk(share) * np.sinc(0.5 * turned / np.pi)
            along = first + 0.5 * turned
            place = place + chord[:, None] * np.stack([np.cos(along), np.sin(along), np.zeros(len(time))], axis=1)
            heading = heading + turned
        begin += phase.duration
    turn = quaternion(np.stack([np.zeros(len(time)), np.zeros(len(time)), heading], axis=1))
    return _about(turn, np.broadcast_to(start, place.shape), place)


def taken_along(script: Script, time: FloatArray, rotation: FloatArray, middle: FloatArray) -> RigidMotion | None:
    """How lifts, shakes and turns of a script move the hand at each sample; None where it has none.

    A lift goes straight up, a shake to and fro across the palm, and a turn about the way that the fingers point,
    through the object's middle; both of these are level, whichever way the palm looks.

    Args:
        script: What the hand does.
        time: Of the samples [s], shape (T,).
        rotation: Of the closed hand, palm to world, shape (3, 3).
        middle: Of the object where it stands [m], shape (3,).
    """
    if not script.takes_along:
        return None
    across, ahead = level(rotation[:, 0], rotation[:, 1]), level(rotation[:, 1], rotation[:, 0])
    place, angle = np.tile(middle, (len(time), 1)), np.zeros(len(time))
    begin = 0.0
    for phase in script.phases:
        share = phase_share(time, begin, phase.duration)
        if phase.name == "lift":
            place = place + (phase.distance * minimum_jerk(share))[:, None] * [0.0, 0.0, 1.0]
        elif phase.name == "shake":
            place = place + (phase.distance * to_and_fro(share, phase.cycles))[:, None] * across
        elif phase.name == "turn":
            angle = angle + phase.turn * minimum_jerk(share)
        begin += phase.duration
    return _about(quaternion(angle[:, None] * ahead), np.broadcast_to(middle, place.shape), place)


def level(direction: FloatArray, otherwise: FloatArray) -> FloatArray:
    """The unit vector along the level part of a direction, or of another one where it stands upright; shape (3,)."""
    for axis in (direction, otherwise):
        flat = np.array([axis[0], axis[1], 0.0])
        length = float(np.linalg.norm(flat))
        if length >= UPRIGHT * float(np.linalg.norm(axis)) and length > 0.0:
            return flat / length
    return np.array([1.0, 0.0, 0.0])


def _about(turn: FloatArray, pivot: FloatArray, place: FloatArray) -> RigidMotion:
    """Turned about a pivot, which goes to a place: all with a row a sample."""
    return RigidMotion(turn, place - RigidMotion(turn, np.zeros_like(place)).points(np.ascontiguousarray(pivot)))
