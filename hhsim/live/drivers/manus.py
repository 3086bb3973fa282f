"""A MANUS glove at NVIDIA's Isaac Teleop (Isaac Capture): its joints come by OpenXR, its motors take powers.

A finger's power is the size of the force on it by the force of full power, at most 1.
"""

import math

import numpy as np

from hhsim.errors import InputError
from hhsim.live.device import FINGER_COUNT, Capability, FingerCommand
from hhsim.live.devices.manus import ManusOptions
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.drivers.openxr import OpenXrHand
from hhsim.live.link.haptic_command import encode_haptic_command

NO_POWER = (0.0,) * FINGER_COUNT


class ManusGlove(OpenXrHand):
    """One glove.

    Args:
        config: With `ManusOptions`.

    Raises:
        InputError: A force of full power that is none.
    """

    NAME = "manus bridge"
    TAKES = Capability.POWER

    def __init__(self, config: GloveConfig) -> None:
        """Nothing is opened yet."""
        super().__init__(config)
        assert isinstance(config.options, ManusOptions)
        self._full_force = config.options.full_force
        if not 0.0 < self._full_force < math.inf:
            raise InputError(f"full force {self._full_force:g} N; expected more than 0")

    def _command(self, command: FingerCommand | None) -> bytes:
        powers = NO_POWER
        if command is not None:
            force = np.add.reduce(command.force, axis=1)
            size = np.sqrt(np.add.reduce(force * force, axis=1)) / self._full_force
            if np.isfinite(size).all():
                powers = tuple(np.minimum(size, 1.0).tolist())
        return encode_haptic_command(self._hand, powers)
