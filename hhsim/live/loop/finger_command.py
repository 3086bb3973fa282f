"""From the graphic hand to what the fingers are commanded.

A finger is stopped at the bend of the graphic hand, with the configured stiffness while its phalanges carry contact
force, and is free otherwise. Both change no faster than the limits allow, but the stiffness falls at once.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import FINGER_COUNT, FingerCommand
from hhsim.live.ipc.config import OutputLimits
from hhsim.result.safety import Safety

Array = NDArray[np.float64]

_SOLVER_FAILED = int(Safety.SOLVER_FAILED)


class FingerCommander:
    """Writes the command of each tick in place.

    Limits count in ticks and not in time: after missed ticks nothing changes faster.

    Args:
        limits: What the fingers may be commanded.
        bend_lines: What a bend is in angles, as of `Calibration.bend_lines`.
        period: Of a tick [s].

    Attributes:
        command: Of the last tick, stiffness 0 before the first.
    """

    def __init__(self, limits: OutputLimits, bend_lines: tuple[Array, Array], period: float) -> None:
        """Every finger is free."""
        self.command = FingerCommand()
        self._turn = np.eye(3)
        self._share = np.zeros(FINGER_COUNT)
        self._configured = np.array(limits.stiffness, np.float64)
        self._rise = limits.stiffness_rise * period
        self._move = limits.bend_speed * period
        self._fall = self._configured * (period / limits.ease)
        self._easing = False
        self._least = np.zeros(FINGER_COUNT)
        self._ramp_ticks = max(1, math.ceil(limits.ramp / period))
        self._contact_force = limits.contact_force
        slope, self._offset = bend_lines
        size = (slope * slope).sum(axis=1, keepdims=True)
        # As `DexmoRegression.bends`, with the division done beforehand.
        self._gain = np.divide(slope, size, out=np.zeros_like(slope), where=size > 0.0)
        self._good_ticks = 0
        self._begun = False
        self._angle = np.zeros((FINGER_COUNT, 3))
        self._bend = np.zeros(FINGER_COUNT)
        self._square = np.zeros((FINGER_COUNT, 3, 3))
        self._norm = np.zeros((FINGER_COUNT, 3))
        self.force = np.zeros(FINGER_COUNT)
        """What the phalanges of each finger feel together in this tick [N], shape (5,)."""
        self._target = np.zeros(FINGER_COUNT)
        self._most = np.zeros(FINGER_COUNT)
        self._free = np.zeros(FINGER_COUNT, dtype=bool)

    def update(
        self,
        flexion: Array,
        phalanx: Array,
        safety: int,
        kept_free: NDArray[np.bool_],
        orientation: Array | None = None,
    ) -> int:
        """Make the command of a tick.

        Args:
            flexion: Of the graphic hand [rad], shape (5, 3).
            phalanx: Force on each phalanx [N], shape (5, 3, 3), world.
            safety: Bits of `Safety`; any of them frees all fingers.
            kept_free: Fingers on which nothing may push, shape (5,).
            orientation: Of the graphic palm, unit (w, x, y, z), shape (4,), world; None where the glove takes no force.

        Returns:
            `safety`, with SOLVER_FAILED where an angle or a force is not finite.
        """
        bend = self._bend
        with np.errstate(all="ignore"):
            finite = self._measure(flexion, phalanx)
        if not finite:
            self.force[:] = 0.0
            self.free()
            return safety | _SOLVER_FAILED
        np.maximum(bend, 0.0, out=bend)
        np.minimum(bend, 1.0, out=bend)
        self._follow(bend)
        if safety:
            self.free()
            return safety
        self._good_ticks = min(self._good_ticks + 1, self._ramp_ticks)
        self._press(kept_free)
        if orientation is not None:
            self._feel(phalanx, orientation)
        return safety

    def free(self) -> None:
        """Stiffness 0, and the ramp from the beginning."""
        self.command.stiffness[:] = 0.0
        self.command.force[:] = 0.0
        self._good_ticks = 0
        self._easing = False

    def ease(self) -> None:
        """The ramp from the beginning, and until it is as high as the stiffness, that falls by `OutputLimits.ease`."""
        self._good_ticks = 0
        self._easing = True

    def _measure(self, flexion: Array, phalanx: Array) -> bool:
        """Bend and force of each finger; False where one is not finite."""
        bend, force = self._bend, self.force
        np.subtract(flexion, self._offset, out=self._angle)
        np.multiply(self._angle, self._gain, out=self._angle)
        np.add.reduce(self._angle, axis=1, out=bend)
        np.multiply(phalanx, phalanx, out=self._square)
        np.add.reduce(self._square, axis=2, out=self._norm)
        np.sqrt(self._norm, out=self._norm)
        np.add.reduce(self._norm, axis=1, out=force)
        return math.isfinite(np.add.reduce(bend)) and math.isfinite(np.add.reduce(force))

    def _follow(self, bend: Array) -> None:
        """Move the set points; the first ones have nowhere to come from, and no finger is held yet."""
        set_point = self.command.bend
        if not self._begun:
            self._begun = True
            set_point[:] = bend
            return
        np.subtract(bend, set_point, out=bend)
        np.maximum(bend, -self._move, out=bend)
        np.minimum(bend, self._move, out=bend)
        np.add(set_point, bend, out=set_point)
        np.maximum(set_point, 0.0, out=set_point)
        np.minimum(set_point, 1.0, out=set_point)

    def _press(self, kept_free: NDArray[np.bool_]) -> None:
        stiffness = self.command.stiffness
        np.multiply(self._configured, self._good_ticks / self._ramp_ticks, out=self._target)
        np.less(self.force, self._contact_force, out=self._free)
        np.logical_or(self._free, kept_free, out=self._free)
        self._target[self._free] = 0.0
        np.add(stiffness, self._rise, out=self._most)
        np.subtract(stiffness, self._fall, out=self._least)
        np.minimum(self._target, self._most, out=stiffness)
        if self._easing:
            self._least[self._free] = 0.0
            self._easing = bool((self._least > stiffness).any())
            np.maximum(stiffness, self._least, out=stiffness)

    def _feel(self, phalanx: Array, orientation: Array) -> None:
        """The forces in the palm's frame, each finger's by the share that its stiffness has of the configured one."""
        w, x, y, z = orientation.tolist()
        turn, force = self._turn, self.command.force
        turn[0] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
        turn[1] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
        turn[2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
        self._share[:] = 0.0
        np.divide(self.command.stiffness, self._configured, out=self._share, where=self._configured > 0.0)
        # Rows times the matrix of the palm are turned back into its frame.
        np.matmul(phalanx, turn, out=force)
        np.multiply(force, self._share[:, None, None], out=force)
