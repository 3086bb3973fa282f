"""Haptic hands tick by tick, written down by formula: what scenes that are no recording are moved by."""

from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hhsim.hand.model import HandModel
from hhsim.motion.quaternion import conjugate, quaternion, quaternion_product, rotation_vector
from hhsim.motion.tick_motion import HandMotion

Array = NDArray[np.float64]

UPRIGHT = (1.0, 0.0, 0.0, 0.0)


class HapticMotion(HandMotion):
    """A hand motion that can be written down step by step."""

    __slots__ = ()

    def part(self, first: int, last: int | None = None) -> Self:
        """Ticks first to last - 1, as copies; negative ones count from the end."""
        return type(self)(*(values[first:last].copy() for values in self))

    def hold(self, ticks: int) -> "HapticMotion":
        """This motion, and its last configuration for some ticks more."""
        return sequence(self, HapticMotion(*(np.repeat(values[-1:], ticks, axis=0) for values in self)))

    def line(self, goal: "HapticMotion", ticks: int) -> "HapticMotion":
        """This motion, and from its last configuration at constant speed to the first one of `goal`, reached last."""
        share = np.arange(1, ticks + 1) / ticks
        parts = [
            a[-1] + share.reshape(-1, *[1] * (a.ndim - 1)) * (b[0] - a[-1]) for a, b in zip(self, goal, strict=True)
        ]
        vector = rotation_vector(quaternion_product(goal.orientation[0], conjugate(self.orientation[-1])))
        parts[1] = quaternion_product(quaternion(share[:, None] * vector), self.orientation[-1])
        return sequence(self, HapticMotion(*parts))


def still(
    position: ArrayLike,
    orientation: ArrayLike = UPRIGHT,
    flexion: ArrayLike = 0.0,
    abduction: ArrayLike = 0.0,
    ticks: int = 1,
) -> HapticMotion:
    """One configuration for some ticks; a single number is the angle of every joint. Units as in `HapticMotion`."""
    shapes = ((3,), (4,), (5, 3), (5,))
    values = (
        np.broadcast_to(np.asarray(value, np.float64), shape)
        for value, shape in zip((position, orientation, flexion, abduction), shapes, strict=True)
    )
    return HapticMotion(*(np.repeat(value[None], ticks, axis=0) for value in values))


def sequence(*motions: HandMotion) -> HapticMotion:
    """One motion after the other."""
    return HapticMotion(*(np.concatenate(parts) for parts in zip(*motions, strict=True)))


def random_targets(
    hand: HandModel,
    ticks: int,
    random: np.random.Generator,
    *,
    hold: int = 60,
    spread: float = 0.06,
    turn: float = 0.8,
    start: Sequence[float] = (0.0, 0.0, 0.25),
) -> HapticMotion:
    """A new random hand every `hold` ticks, at a jump: the stress that the coupled program was first measured by.

    Args:
        hand: Its limits bound flexion and abduction.
        ticks: T.
        random: Source of everything random.
        hold: Ticks that a target stands.
        spread: Standard deviation of the position about the origin [m].
        turn: Of the rotation vector [rad].
        start: Position of the first target [m].
    """
    count = -(-ticks // hold)
    position = random.normal(0.0, spread, (count, 3))
    position[0] = start
    orientation = quaternion(random.normal(0.0, turn, (count, 3)))
    flexion = random.uniform(hand.flexion_min, hand.flexion_max, (count, 5, 3))
    abduction = random.uniform(hand.abduction_min, hand.abduction_max, (count, 5))
    parts = (position, orientation, flexion, abduction)
    return HapticMotion(*(np.repeat(part, hold, axis=0)[:ticks] for part in parts))
