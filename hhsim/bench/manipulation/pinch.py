"""Tasks and their outcomes: a pinch (close on a block, squeeze, lift, hold), and a cube at rest on a table."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.bench.manipulation.stage import turned_by
from hhsim.scene.synthesis import minimum_jerk

RATE = 1000.0
"""Tick rate [Hz]."""
QUIET = 500
"""Ticks of a hold, or a quarter of it, until the lift has decayed."""
LIFTED = 0.9
"""Least share of the way of a block that was lifted."""


@dataclass(frozen=True)
class PinchOutcome:
    """Outcome of a pinch; figures of the hold are those after its first `QUIET` ticks.

    Attributes:
        lifted: True if the block was lifted.
        creep: Change of the block's height in the hold [m]; NaN if it was not lifted.
        depth: Largest depth of a fingertip in the block [m].
    """

    lifted: bool
    creep: float
    depth: float


@dataclass(frozen=True)
class Pinch:
    """Task of a pinch.

    Attributes:
        mass: Of the block [kg].
        friction: μ of all contacts.
        squeeze: Normal force of each fingertip [N].
        hold: Duration of the hold [s].
        side: Of the block, a cube [m].
        stiffness: Of the coupling of each fingertip, in all directions [N/m].
        lift: Height of the lift [m].
        gap: Between fingertip and block at first [m].
        closing, settling, lifting, easing: Durations before the hold [s].
        eased: Share of the squeeze that is left after the easing.
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
        """Number of ticks."""
        return self.held_from + round(RATE * self.hold)

    def closed_at(self, tick: ArrayLike) -> FloatArray:
        """Return the share of the way to first contact at the ticks: 0 to 1 in the first half of the closing."""
        return minimum_jerk(np.asarray(tick) / (0.5 * RATE * self.closing))

    def squeeze_at(self, tick: ArrayLike) -> FloatArray:
        """Return the commanded force at the ticks [N]: it grows at the end of the closing, and falls in the easing."""
        pressed = self.squeeze * minimum_jerk(np.asarray(tick) / (0.5 * RATE * self.closing) - 1.0)
        if self.easing == 0.0:
            return np.asarray(pressed)
        gone = np.clip((np.asarray(tick) - self.eased_from) / (RATE * self.easing), 0.0, 1.0)
        return np.asarray(pressed * (1.0 - (1.0 - self.eased) * gone))

    def height_at(self, tick: ArrayLike) -> FloatArray:
        """Return the commanded height at the ticks [m]."""
        start = RATE * (self.closing + self.settling)
        return self.lift * minimum_jerk((np.asarray(tick) - start) / (RATE * self.lifting))

    def outcome(self, height: FloatArray, depth: float) -> PinchOutcome:
        """Return the outcome from the block's height over its start at every tick [m], shape (ticks,)."""
        held = height[self.held_from :]
        lifted = bool(held[0] > LIFTED * self.lift)
        rest = held[min(QUIET, len(held) // 4) :]
        creep = float(np.abs(rest - rest[0]).max()) if lifted else float("nan")
        return PinchOutcome(lifted, creep, depth)


@dataclass(frozen=True)
class Rest:
    """Task of a cube at rest on a table, in s, kg, m and m/s²; `friction` is μ of cube and table."""

    seconds: float = 600.0
    mass: float = 0.24
    friction: float = 0.6
    side: float = 0.07
    gravity: float = 9.81

    def creep(self, center: FloatArray, orientation: FloatArray) -> float:
        """Return the largest way of a corner [m].

        Args:
            center: Of the cube at every tick [m], shape (ticks, 3).
            orientation: Of the first and the last of them, (w, x, y, z), shape (2, 4).
        """
        moved = float(np.linalg.norm(center - center[0], axis=1).max())
        return moved + 0.5 * self.side * math.sqrt(3.0) * turned_by(orientation[0], orientation[1])
