"""A hand that a headset tracks: OpenXR's 26 joints, by a bridge that sends them as open packets of the kind `HAND`.

Order, frames and radii of the joints are those of XR_EXT_hand_tracking (OpenXR 1.1, `XrHandJointEXT` and
`XrHandJointLocationEXT`).
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hhsim.live.device import Capability, GloveInfo, PalmReading
from hhsim.live.devices.openxr import HandOptions
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.drivers.packet_glove import PacketGlove
from hhsim.live.link.udp_codec import Kind, Packet

if TYPE_CHECKING:
    from hhsim.live.drivers.tracked_hand import TrackedHand

Array = NDArray[np.float64]


class OpenXrHand(PacketGlove):
    """A tracked hand, which is told nothing.

    Args:
        config: With `HandOptions`.
    """

    SAMPLES = (Kind.HAND,)
    NAME = "openxr hand"
    TAKES = Capability.NONE
    _fit: "TrackedHand"
    """From `open` on."""

    def __init__(self, config: GloveConfig) -> None:
        """Nothing is opened yet."""
        options = config.options
        assert isinstance(options, HandOptions)
        super().__init__(options.host, options.port, self.NAME)
        self._hand = config.hand
        self.palm: PalmReading = PalmReading()

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`."""
        # Here: what only frees the fingers needs neither the hand nor a compiled kernel.
        from hhsim.live.drivers.tracked_hand import TrackedHand

        self._fit = TrackedHand(self._hand)
        super().open(timeout)

    def _take(self, values: Array, now_ns: int) -> bool:
        fit, palm = self._fit, self.palm
        if not fit.take(values):
            return False
        self._flexion, self._abduction = fit.flexion, fit.abduction
        palm.position[:], palm.orientation[:], palm.came_ns = fit.position, fit.orientation, now_ns
        return True

    def _channels(self, values: Array) -> Array:
        return self._fit.joints.ravel()

    def _describe(self, first: Packet) -> GloveInfo:
        from hhsim.live.drivers.tracked_hand import CHANNELS

        can = Capability.JOINTS | Capability.SPLAY | Capability.STAMPS | Capability.PALM | self.TAKES
        if first.battery >= 0:
            can |= Capability.BATTERY
        return GloveInfo(self._name, can, CHANNELS, hand=self._hand, unit="m")
