"""Configurations tick by tick as a trajectory, and as a replay of that trajectory gives them to a solver."""

import numpy as np

from hhsim.hand.configuration import HandConfiguration
from hhsim.kernels.hand.pose import is_finite_configuration
from hhsim.motion.resample import tick_times
from hhsim.motion.trajectory import MAX_ANGLE, MAX_POSITION, Trajectory

RATE = 1000.0
"""Ticks per second [Hz]."""


def hold_readings(motion: HandConfiguration) -> HandConfiguration:
    """The motion as the solver sees it: a tick that is no reading of a hand repeats the last one that is.

    Ticks before the first reading take that one. Where there is no reading at all, nothing is changed.
    """
    sound = np.array([is_finite_configuration(*sample) for sample in zip(*motion)], dtype=bool)
    if sound.all() or not sound.any():
        return motion.copy()
    newest = np.maximum.accumulate(np.where(sound, np.arange(motion.ticks), -1))
    return motion.at(np.where(newest < 0, int(np.argmax(sound)), newest))


def replayed(motion: HandConfiguration) -> HandConfiguration:
    """The motion as a replay of its trajectory gives it to the solver.

    Held, with unit quaternions of steady sign, and nothing beyond what a trajectory may hold.
    """
    whole = hold_readings(motion)
    bounded = whole._replace(
        position=np.clip(whole.position, -MAX_POSITION, MAX_POSITION),
        flexion=np.clip(whole.flexion, -MAX_ANGLE, MAX_ANGLE),
        abduction=np.clip(whole.abduction, -MAX_ANGLE, MAX_ANGLE),
    )
    return HandConfiguration.of(trajectory_of(bounded).resampled(RATE, "hold"))


def trajectory_of(motion: HandConfiguration, *, name: str = "", source: str = "") -> Trajectory:
    """A checked trajectory with one sample a tick, so that a replay at `RATE` gets the same samples.

    Args:
        motion: One configuration a tick.
        source: Who or what made the motion.

    Raises:
        TrajectoryError: The motion holds what no trajectory may; `hold_readings` mends NaN and zero quaternions.
    """
    time = tick_times((motion.ticks - 1) / RATE, RATE)
    return Trajectory(time, *motion, name=name, source=source)
