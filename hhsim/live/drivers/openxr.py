"""Drivers of a hand tracked by a headset (OpenXR's 26 joints as open packets of kind `HAND`), and of a MANUS glove.

Order and frames of the joints are those of XR_EXT_hand_tracking (OpenXR 1.1). A MANUS glove at NVIDIA's Isaac Teleop is
such a hand with motors that shake the fingers: their power is the finger's force over the force of full power.
"""

import math
import struct
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.live.device import FINGER_COUNT, Capability, FingerCommand, GloveInfo, PalmReading
from hhsim.live.devices.manus import ManusOptions
from hhsim.live.devices.registry import GloveConfig, ReachedOptions
from hhsim.live.drivers.packet_glove import PacketGlove
from hhsim.live.link.udp_codec import Kind, Packet

if TYPE_CHECKING:
    from hhsim.live.drivers.tracked_hand import TrackedHand

NO_POWER = (0.0,) * FINGER_COUNT


class OpenXrHand(PacketGlove):
    """Tracked hand, which takes no commands."""

    SAMPLES = (Kind.HAND,)
    NAME = "openxr hand"
    TAKES = Capability.NONE
    _fit: "TrackedHand"

    def __init__(self, config: GloveConfig) -> None:
        options = config.options
        assert isinstance(options, ReachedOptions)
        super().__init__(options.host, options.port, self.NAME)
        self._hand = config.hand
        self.palm: PalmReading = PalmReading()

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`."""
        # A release alone needs neither the hand nor a compiled kernel.
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
    """One glove; InputError for a force of full power that is not positive."""

    NAME = "manus bridge"
    TAKES = Capability.POWER

    def __init__(self, config: GloveConfig) -> None:
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


_BEFORE = struct.Struct("<I4Hi3I")
_FIVE = struct.Struct("<5f")
_HEAD = _BEFORE.pack(12, 8, 12, 4, 8, 8, 32, 4, 5)
_TAIL = {name: struct.pack("<I8s", len(name), name.encode()) for name in ("left", "right")}


def encode_haptic_command(endpoint: str, powers: Sequence[float]) -> bytes:
    """Encode a `HapticCommand` of NVIDIA's Isaac Teleop, byte for byte as FlatBuffers' own builder does.

    A table of two fields, `endpoint` (string, id 0) and `values` (vector of float32, id 1): facts of
    `src/core/schema/fbs/haptic_command.fbs` and `src/plugins/manus` of github.com/NVIDIA/IsaacTeleop (Apache-2.0).

    | bytes | content, little-endian |
    |---|---|
    | 0 | uint32, offset of the table: 12 |
    | 4 | its vtable, uint16: own size 8, table's size 12, endpoint at 4 in the table, values at 8 |
    | 12 | the table: int32 back to the vtable 8; uint32 on to the endpoint 32; uint32 on to the values 4 |
    | 24 | the values: uint32 5, then five float32, thumb to little finger, 0 to 1 |
    | 48 | the endpoint: uint32 length, its letters, zeros to a multiple of four, one at least |

    The endpoint is "left" or "right"; powers are 0 to 1, thumb to little finger.
    """
    return _HEAD + _FIVE.pack(*powers) + _TAIL[endpoint]
