"""Postures and motions that several hard cases share, and crossings of discs and rings."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.robustness.objects import right_hand
from hhsim.hand.configuration import HandConfiguration, sequence
from hhsim.hand.quaternion import quaternion, quaternion_product
from hhsim.motion.analytic_motion import UPRIGHT, still

CURLED = (1.2, 1.4, 0.8)
"""Flexion [rad] of a finger that is out of the way."""
POINTING = np.array([(0.3, 0.4, 0.3), (0.0, 0.0, 0.0), CURLED, CURLED, CURLED])
"""Flexion [rad] of a hand whose index finger alone is straight."""
HALF = np.full((5, 3), 0.3)
"""Flexion [rad] of an open hand, slightly curved."""
FIST = np.array([(0.4, 0.7, 0.8), *((1.3, 1.6, 1.0),) * 4])
"""Flexion [rad] of a closed fist."""
INDEX = 1
"""Number of the index finger."""
RIM = 0.01
"""Margin [m] within the rim of a disc: a point that passes farther inside has gone through it and not around it."""


def handling(ticks: int) -> HandConfiguration:
    """Return a hand that comes to the ball of 38 mm in 200 ticks, closes on it a little, and is moved and tilted there.

    It is so gentle that nothing slips or jumps: two methods, or two runs of one, can be compared tick by tick. `ticks`
    are at least 300.
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


def squeeze() -> HandConfiguration:
    """Return index and middle finger that close by abduction on what is between them, and open again, three times."""
    hand, ticks = right_hand(), 900
    motion = still(np.zeros(3), flexion=0.1, ticks=ticks)
    wave = 0.3 * np.sin(2.0 * np.pi * np.arange(ticks) / 300.0)[:, None]
    motion.abduction[:] = np.clip(wave * [1.0, -1.0, 1.0, 1.0, 1.0], hand.abduction_min, hand.abduction_max)
    return sequence(still((0.0, 0.0, 0.08), flexion=0.1).line(motion, 100), motion)


def shifted(pose: HandConfiguration, x: float, y: float, z: float) -> HandConfiguration:
    """Return the motion with its palm moved by (x, y, z) [m]."""
    return pose._replace(position=pose.position + np.array([x, y, z]))


def joints_at_origin(flexion: ArrayLike, orientation: ArrayLike = UPRIGHT) -> FloatArray:
    """Return the joints [m] of the hand whose palm is at the origin, shape (5, 4, 3)."""
    return right_hand().joints(np.zeros(3), orientation, flexion, np.zeros(5))


def tip_at(
    point: ArrayLike, orientation: ArrayLike = UPRIGHT, flexion: ArrayLike = POINTING, finger: int = INDEX
) -> FloatArray:
    """Return the palm position [m] that puts a fingertip's centre at `point` [m], shapes (3,)."""
    return np.asarray(np.asarray(point) - joints_at_origin(flexion, orientation)[finger, 3], np.float64)


def poke() -> HandConfiguration:
    """Return an index finger that is pushed along y through the origin and held 30 mm behind it."""
    tip = still(tip_at(np.zeros(3)), flexion=POINTING)
    return shifted(tip, 0.0, -0.05, 0.0).hold(4).line(shifted(tip, 0.0, 0.03, 0.0), 100).hold(100)


def crossings(points: FloatArray, radius: float) -> int:
    """Return how often a point of a hand goes through a disc in the plane z = 0 from one tick to the next.

    Points [m] have shape (T, n, 3). The radius of the disc about the origin [m] is less than the object's, so that the
    way around its rim does not count.
    """
    before, after = points[:-1], points[1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = before[..., 2] / (before[..., 2] - after[..., 2])
        where = before[..., :2] + share[..., None] * (after[..., :2] - before[..., :2])
        through = (before[..., 2] * after[..., 2] < 0.0) & (np.linalg.norm(where, axis=-1) < radius)
    return int(through.sum())


def threaded(joints: FloatArray, center: FloatArray, axis: FloatArray, radius: float) -> BoolArray:
    """Return the ticks at which a finger's centre line goes through a ring, shape (T,).

    Joints [m] have shape (T, 4, 3), the ring's centre [m] and unit axis (3,); `radius` [m] is its profile's middle.
    """
    height = (joints - center) @ axis
    before, after = height[:, :-1], height[:, 1:]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = before / (before - after)
        where = joints[:, :-1] + share[..., None] * (joints[:, 1:] - joints[:, :-1]) - center
        inside = (before * after <= 0.0) & (np.linalg.norm(where, axis=-1) < radius)
    return np.asarray(inside.sum(axis=1) % 2 == 1)
