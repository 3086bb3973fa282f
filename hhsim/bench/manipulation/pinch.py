"""The task of a pinch: close on a block, squeeze, lift it, hold it; and what came of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.scene.hand_moves import minimum_jerk

RATE = 1000.0
"""Ticks per second [Hz]."""
QUIET = 500
"""Ticks of a hold, or a quarter of it, until the lift has died away."""
LIFTED = 0.9
"""A block that came along for this share of the way at least was lifted."""


@dataclass(frozen=True)
class PinchOutcome:
    """What a pinch came to; figures of the hold are those after its first `QUIET` ticks.

    Attributes:
        lifted: Whether the block came along.
        hangs: How far below the command the block hangs [m]; NaN where it was not lifted.
        creep: How far the block's height changes in the hold [m]; NaN where it was not lifted.
        depth: Deepest that a fingertip was in the block [m].
        squeeze: Normal force on a fingertip in the hold, mean [N]; NaN where nobody looked.
    """

    lifted: bool
    hangs: float
    creep: float
    depth: float
    squeeze: float = float("nan")


@dataclass(frozen=True)
class Pinch:
    """What is pinched, how hard, and how far it is lifted.

    Attributes:
        mass: Of the block [kg].
        friction: μ of all contacts.
        squeeze: Normal force of each fingertip [N].
        hold: How long the block is held aloft [s].
        side: Of the block, a cube [m].
        tip_radius: Of the fingertips [m].
        stiffness: Of the coupling of each fingertip, in all directions [N/m].
        lift: How far up [m].
        gap: Between fingertip and block at first [m].
        closing, settling, lifting: How long the fingers close and press, wait, and lift [s].
        easing: How long they then ease [s], before the hold.
        eased: To which share of the squeeze.
        gravity: [m/s²].
    """

    mass: float = 0.1
    friction: float = 0.5
    squeeze: float = 1.03
    hold: float = 20.0
    side: float = 0.04
    tip_radius: float = 0.008
    stiffness: float = 1000.0
    lift: float = 0.03
    gap: float = 0.002
    closing: float = 0.3
    settling: float = 0.2
    lifting: float = 1.0
    easing: float = 0.0
    eased: float = 1.0
    gravity: float = 9.81

    @property
    def threshold(self) -> float:
        """Least squeeze that bears the weight, m g / 2 μ [N]."""
        return self.mass * self.gravity / (2.0 * self.friction)

    @property
    def held_from(self) -> int:
        """First tick of the hold."""
        return self.eased_from + round(RATE * self.easing)

    @property
    def eased_from(self) -> int:
        """First tick of the easing."""
        return round(RATE * (self.closing + self.settling + self.lifting))

    @property
    def ticks(self) -> int:
        """Of the whole."""
        return self.held_from + round(RATE * self.hold)

    def closed_at(self, tick: ArrayLike) -> FloatArray:
        """Share of the way to first contact at the ticks, 0 to 1: in the first half of the closing."""
        return minimum_jerk(np.asarray(tick) / (0.5 * RATE * self.closing))

    def squeeze_at(self, tick: ArrayLike) -> FloatArray:
        """Force commanded at the ticks [N]: grows in the second half of the closing, and falls evenly in the easing."""
        pressed = self.squeeze * minimum_jerk(np.asarray(tick) / (0.5 * RATE * self.closing) - 1.0)
        if self.easing == 0.0:
            return np.asarray(pressed)
        gone = np.clip((np.asarray(tick) - self.eased_from) / (RATE * self.easing), 0.0, 1.0)
        return np.asarray(pressed * (1.0 - (1.0 - self.eased) * gone))

    def height_at(self, tick: ArrayLike) -> FloatArray:
        """Height commanded at the ticks [m]."""
        start = RATE * (self.closing + self.settling)
        return self.lift * minimum_jerk((np.asarray(tick) - start) / (RATE * self.lifting))

    def outcome(self, height: FloatArray, depth: float, squeeze: float = float("nan")) -> PinchOutcome:
        """Of the block's height over where it stood at every tick [m], shape (ticks,)."""
        held = height[self.held_from :]
        lifted = bool(held[0] > LIFTED * self.lift)
        rest = held[min(QUIET, len(held) // 4) :]
        creep = float(np.abs(rest - rest[0]).max()) if lifted else float("nan")
        hangs = self.lift - float(rest[0]) if lifted else float("nan")
        return PinchOutcome(lifted, hangs, creep, depth, squeeze)
