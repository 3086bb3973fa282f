"""Haptic hands tick by tick by formula, for scenes that are no recording, and how trajectory and replay have them."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import BoolArray
from hhsim.hand.configuration import SHAPES, HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion
from hhsim.kernels.hand.pose import is_finite_configuration
from hhsim.motion.resample import tick_times
from hhsim.motion.trajectory import MAX_ANGLE, MAX_POSITION, Trajectory

RATE = 1000.0
"""Ticks a second [Hz]."""
UPRIGHT = (1.0, 0.0, 0.0, 0.0)
SPREAD, TURN = 0.06, 0.8
"""Standard deviations of a random hand's position about the origin [m] and of its rotation vector [rad]."""
START = (0.0, 0.0, 0.25)
"""Position of the first random target [m]."""


def sound_samples(motion: HandConfiguration) -> BoolArray:
    """Return the samples that are a hand's, shape (T,), from the input itself."""
    return np.array([is_finite_configuration(*sample) for sample in zip(*motion, strict=True)], dtype=bool)


def hold_readings(motion: HandConfiguration) -> HandConfiguration:
    """Return the motion with each tick that is no valid reading replaced by the last valid one before it.

    Ticks before the first reading take that one. Without any, nothing is changed.
    """
    sound = sound_samples(motion)
    if sound.all() or not sound.any():
        return motion.copy()
    newest = np.maximum.accumulate(np.where(sound, np.arange(motion.ticks), -1))
    return motion.at(np.where(newest < 0, int(np.argmax(sound)), newest))


def replayed(motion: HandConfiguration) -> HandConfiguration:
    """Return the motion as a replay of its trajectory gives it to the solver.

    Invalid readings are held, quaternions are unit and without sign flips, and values are within a trajectory's limits.
    """
    whole = hold_readings(motion)
    bounded = whole._replace(
        position=np.clip(whole.position, -MAX_POSITION, MAX_POSITION),
        flexion=np.clip(whole.flexion, -MAX_ANGLE, MAX_ANGLE),
        abduction=np.clip(whole.abduction, -MAX_ANGLE, MAX_ANGLE),
    )
    return HandConfiguration.of(trajectory_of(bounded).resampled(RATE, "hold"))


def trajectory_of(motion: HandConfiguration, *, name: str = "", source: str = "") -> Trajectory:
    """Make a checked trajectory with one sample a tick, so that a replay at `RATE` gets the same samples.

    Raises TrajectoryError for values that a trajectory refuses; `hold_readings` replaces NaN and zero quaternions.
    """
    time = tick_times((motion.ticks - 1) / RATE, RATE)
    return Trajectory(time, *motion, name=name, source=source)


def still(
    position: ArrayLike,
    orientation: ArrayLike = UPRIGHT,
    flexion: ArrayLike = 0.0,
    abduction: ArrayLike = 0.0,
    ticks: int = 1,
) -> HandConfiguration:
    """Repeat one configuration for some ticks; a single number is the angle of every joint."""
    given = zip((position, orientation, flexion, abduction), SHAPES.values(), strict=True)
    values = (np.broadcast_to(np.asarray(value, np.float64), shape) for value, shape in given)
    return HandConfiguration(*(np.repeat(value[None], ticks, axis=0) for value in values))


def random_targets(hand: HandModel, ticks: int, random: np.random.Generator, *, hold: int = 60) -> HandConfiguration:
    """Generate a new random hand every `hold` ticks, without a transition, within the joint limits of `hand`."""
    count = -(-ticks // hold)
    position = random.normal(0.0, SPREAD, (count, 3))
    position[0] = START
    orientation = quaternion(random.normal(0.0, TURN, (count, 3)))
    flexion = random.uniform(hand.flexion_min, hand.flexion_max, (count, 5, 3))
    abduction = random.uniform(hand.abduction_min, hand.abduction_max, (count, 5))
    parts = (position, orientation, flexion, abduction)
    return HandConfiguration(*(np.repeat(part, hold, axis=0)[:ticks] for part in parts))
