"""Postures and crossings that several hard cases share."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.motion.analytic_motion import UPRIGHT, still

CURLED = (1.2, 1.4, 0.8)
"""Flexion [rad] of a finger that is out of the way."""

POINTING = np.array([(0.3, 0.4, 0.3), (0.0, 0.0, 0.0), CURLED, CURLED, CURLED])
"""Only the index finger is straight [rad]."""

HALF = np.full((5, 3), 0.3)
"""An open hand, slightly curved [rad]."""

FIST = np.array([(0.4, 0.7, 0.8), *((1.3, 1.6, 1.0),) * 4])
"""Flexion [rad] of a closed fist."""

INDEX = 1
"""Place of the index finger."""


def handling(ticks: int) -> HandConfiguration:
    """A hand that comes to the ball of 38 mm, closes on it a little, and is moved and tilted there.

    Gentle enough that nothing slips or snaps: two methods, or two runs of one, can be compared tick by tick.

    Args:
        ticks: At least 300; the first 200 are the way there.
    """
    above = still((0.0, -0.045, 0.12), flexion=HALF)
    pressed = still((0.0, -0.045, 0.058), flexion=np.full((5, 3), 0.7))
    motion = above.hold(9).line(pressed, 190).hold(ticks - 200)
    time = np.linspace(0.0, 1.0, ticks - 200)[:, None]
    wave = np.sin(2.0 * np.pi * time * [1.0, 2.0, 3.0])
    motion.position[200:] += wave * [0.0015, 0.0015, 0.001]
    motion.orientation[200:] = quaternion_product(quaternion(wave[:, ::-1] * [0.015, 0.02, 0.015]), UPRIGHT)
    motion.flexion[200:] += 0.015 * wave[:, :1, None]
    return motion


def tip_at(
    hand: HandModel, point: FloatArray, orientation: FloatArray, flexion: FloatArray, finger: int = INDEX
) -> FloatArray:
    """Palm position [m] that puts a fingertip's centre at `point` [m], shapes (3,)."""
    joints = hand.joints(np.zeros(3), orientation, flexion, np.zeros(5))
    place: FloatArray = np.asarray(point, np.float64) - joints[finger, 3]
    return place


def crossings(points: FloatArray, radius: float) -> int:
    """How often a point of a hand goes, from one tick to the next, through the disc in the plane z = 0.

    Args:
        points: [m], shape (T, n, 3).
        radius: Of the disc about the origin [m]: less than the object's, so that the way around its rim is none.
    """
    before, after = points[:-1], points[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = before[..., 2] / (before[..., 2] - after[..., 2])
        where = before[..., :2] + share[..., None] * (after[..., :2] - before[..., :2])
        through = (before[..., 2] * after[..., 2] < 0.0) & (np.linalg.norm(where, axis=-1) < radius)
    return int(through.sum())


def threaded(joints: FloatArray, center: FloatArray, axis: FloatArray, radius: float) -> BoolArray:
    """Ticks at which a finger's centre line goes through a ring, shape (T,).

    Args:
        joints: Of the finger [m], shape (T, 4, 3).
        center: Of the ring [m], shape (3,).
        axis: Unit vector, shape (3,).
        radius: To the middle of the ring's profile [m].
    """
    height = (joints - center) @ axis
    before, after = height[:, :-1], height[:, 1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = before / (before - after)
        where = joints[:, :-1] + share[..., None] * (joints[:, 1:] - joints[:, :-1]) - center
        inside = (before * after <= 0.0) & (np.linalg.norm(where, axis=-1) < radius)
    through: BoolArray = inside.sum(axis=1) % 2 == 1
    return through
