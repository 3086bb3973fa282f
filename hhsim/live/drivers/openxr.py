"""A hand that a headset tracks: OpenXR's 26 joints, by a bridge that sends them as open packets of the kind `HAND`.

Order, frames and radii of the joints are those of XR_EXT_hand_tracking (OpenXR 1.1, `XrHandJointEXT` and
`XrHandJointLocationEXT`). A MANUS glove at NVIDIA's Isaac Teleop (Isaac Capture) is such a hand whose fingers can be
shaken: its motors take powers, the size of the force on a finger by the force of full power, at most 1.
"""

import math
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.live.device import FINGER_COUNT, Capability, FingerCommand, GloveInfo, PalmReading
from hhsim.live.devices.manus import ManusOptions
from hhsim.live.devices.registry import GloveConfig, ReachedOptions
from hhsim.live.drivers.packet_glove import PacketGlove
from hhsim.live.link.haptic_command import encode_haptic_command
from hhsim.live.link.udp_codec import Kind, Packet

if TYPE_CHECKING:
    from hhsim.live.drivers.tracked_hand import TrackedHand

NO_POWER = (0.0,) * FINGER_COUNT


class OpenXrHand(PacketGlove):
    """A tracked hand, which is told nothing.

    Args:
        config: With a host and a port.
    """

    SAMPLES = (Kind.HAND,)
    NAME = "openxr hand"
    TAKES = Capability.NONE
    _fit: "TrackedHand"
    """From `open` on."""

    def __init__(self, config: GloveConfig) -> None:
        """Nothing is opened yet."""
        options = config.options
        assert isinstance(options, ReachedOptions)
        super().__init__(options.host, options.port, self.NAME)
        self._hand = config.hand
        self.palm: PalmReading = PalmReading()

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`."""
        # Here: what only frees the fingers needs neither the hand nor a compiled kernel.
        from hhsim.live.drivers.tracked_hand import TrackedHand

        self._fit = TrackedHand(self._hand)
        super().open(timeout)

    def _take(self, values: FloatArray, now_ns: int) -> bool:
        fit, palm = self._fit, self.palm
        if not fit.take(values):
            return False
        self._flexion, self._abduction = fit.flexion, fit.abduction
        palm.position[:], palm.orientation[:], palm.came_ns = fit.position, fit.orientation, now_ns
        return True

    def _channels(self, values: FloatArray) -> FloatArray:
        return self._fit.joints.ravel()

    def _describe(self, first: Packet) -> GloveInfo:
        from hhsim.live.drivers.tracked_hand import CHANNELS

        can = Capability.JOINTS | Capability.SPLAY | Capability.STAMPS | Capability.PALM | self.TAKES
        if first.battery >= 0:
            can |= Capability.BATTERY
        return GloveInfo(self._name, can, CHANNELS, hand=self._hand, unit="m")


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
