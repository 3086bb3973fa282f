"""The limits by which `hhsim.kernels.live.finger_command` commands the fingers, and the command."""

import math
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.kernels.live.finger_command import COMMANDER
from hhsim.live.device import FingerCommand
from hhsim.live.ipc.config import OutputLimits
from hhsim.solver.workspace import zeroed


class FingerCommander:
    """Holds the command of each tick, which is written in place.

    Args:
        limits: What the fingers may be commanded.
        bend_lines: What a bend is in angles, as of `Calibration.bend_lines`.
        period: Of a tick [s].
        feels: Whether the glove takes forces, or powers that are made of them.

    Attributes:
        state: Of `COMMANDER`, shape (1,).
        at: Its one record.
        command: Of the last tick, stiffness and forces 0 before the first.
        force: What the phalanges of each finger felt together in it [N], shape (5,).
    """

    def __init__(
        self, limits: OutputLimits, bend_lines: tuple[FloatArray, FloatArray], period: float, *, feels: bool = False
    ) -> None:
        """Every finger is free."""
        self.state = zeroed(COMMANDER)
        self.at: Any = self.state[0]
        slope, offset = bend_lines
        size = (slope * slope).sum(axis=1, keepdims=True)
        self.at.configured[:] = limits.stiffness
        self.at.rise = limits.stiffness_rise * period
        self.at.move = limits.bend_speed * period
        self.at.fall[:] = self.at.configured * (period / limits.ease)
        self.at.ramp_ticks = max(1, math.ceil(limits.ramp / period))
        self.at.contact_force = limits.contact_force
        self.at.feels = int(feels)
        # As `DexmoRegression.bends`, with the division done beforehand.
        self.at.gain[:] = np.divide(slope, size, out=np.zeros_like(slope), where=size > 0.0)
        self.at.offset[:] = offset
        names = ("bend", "stiffness", "phalanx")
        self.command = FingerCommand(*(self.state[name][0] for name in names))
        self.force: FloatArray = self.state["force"][0]
