"""Haptic hands tick by tick by formula, for scenes that are no recording."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion

UPRIGHT = (1.0, 0.0, 0.0, 0.0)
SPREAD, TURN = 0.06, 0.8
"""Standard deviations of a random hand's position about the origin [m] and of its rotation vector [rad]."""
START = (0.0, 0.0, 0.25)
"""Position of the first random target [m]."""


def still(
    position: ArrayLike,
    orientation: ArrayLike = UPRIGHT,
    flexion: ArrayLike = 0.0,
    abduction: ArrayLike = 0.0,
    ticks: int = 1,
) -> HandConfiguration:
    """Repeat one configuration for some ticks; a single number is the angle of every joint."""
    shapes = ((3,), (4,), (5, 3), (5,))
    values = (
        np.broadcast_to(np.asarray(value, np.float64), shape)
        for value, shape in zip((position, orientation, flexion, abduction), shapes, strict=True)
    )
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
