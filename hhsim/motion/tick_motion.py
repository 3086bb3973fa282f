"""Configurations tick by tick as a trajectory, and as a replay of it gives them to a solver."""

import numpy as np

from hhsim.arrays import BoolArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.hand.pose import is_finite_configuration
from hhsim.motion.resample import tick_times
from hhsim.motion.trajectory import MAX_ANGLE, MAX_POSITION, Trajectory

RATE = 1000.0
"""Ticks a second [Hz]."""


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
