"""Driver of any glove, through a bridge that speaks the open packet of `hhsim.live.link.udp_codec`."""

import math
import time
from typing import TYPE_CHECKING, cast

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.live.device import FINGER_COUNT, Capability, FingerCommand, GloveInfo
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.devices.udp import TAKES, UdpOptions
from hhsim.live.drivers.packet_glove import PacketGlove
from hhsim.live.link.udp_codec import Kind, Packet, encode_packet

if TYPE_CHECKING:
    from hhsim.live.drivers.calibration import GloveCalibration

MOST_ANGLE = 2.0 * math.pi
NO_LIMIT = np.zeros(10)
NO_FORCE = np.zeros((FINGER_COUNT, 3))


class UdpGlove(PacketGlove):
    """Glove of a bridge that takes limits of fingers or forces on tips; InputError for other commands, a force ≤ 0."""

    SAMPLES = (Kind.BENDS, Kind.CHANNELS, Kind.JOINTS)

    def __init__(self, config: GloveConfig) -> None:
        options = config.options
        assert isinstance(options, UdpOptions)
        super().__init__(options.host, options.port, "udp bridge")
        if options.takes not in TAKES:
            raise InputError(f"a glove that takes '{options.takes}'; expected {' or '.join(TAKES)}")
        if not 0.0 < options.most_force < math.inf:
            raise InputError(f"most force {options.most_force:g} N; expected more than 0")
        self._forces = options.takes == "forces"
        self._most_force = options.most_force
        self._calibration = self._configured = cast("GloveCalibration", config.calibration)
        self._hand = config.hand

    def _command(self, command: FingerCommand | None) -> bytes:
        if self._forces:
            kind, numbers = Kind.FORCES, NO_FORCE if command is None else limited(command.force[:, 2], self._most_force)
        else:
            kind, numbers = Kind.COMMAND, NO_LIMIT
            if command is not None:
                told = np.concatenate([command.bend, command.stiffness])
                numbers = np.clip(told, 0.0, 1.0) if np.isfinite(told).all() else NO_LIMIT
        now = time.monotonic_ns()
        return encode_packet(kind, numbers, session=self._session, seq=self._sent, t_ns=now, answers=self._answers)

    def _take(self, values: FloatArray, now_ns: int) -> bool:
        if not np.isfinite(values).all():
            return False
        if self._kind is Kind.JOINTS:
            if (np.abs(values) > MOST_ANGLE).any():
                return False
            self._flexion, self._abduction = values[:15].reshape(FINGER_COUNT, 3), values[15:]
            return True
        calibration = self._calibration
        if self._kind is Kind.BENDS:
            low, high = calibration.bend_ends()
            values = calibration.readings(low + values * (high - low))
        found = calibration.angles(values)
        if found is None:
            return False
        self._flexion, self._abduction = found
        return True

    def _describe(self, first: Packet) -> GloveInfo:
        from hhsim.recordings.column_map import JOINT_NAMES
        from hhsim.recordings.dexmo_regression import BEND, CHANNELS

        self._calibration = self._configured
        if first.kind is Kind.CHANNELS and np.isfinite(first.values).all():
            self._calibration = self._configured.fitting(first.values.tolist())
        names = {
            Kind.BENDS: tuple(CHANNELS[index] for index in BEND),
            Kind.CHANNELS: CHANNELS,
            Kind.JOINTS: JOINT_NAMES,
        }
        calibrated = self._kind is Kind.CHANNELS
        can = Capability.FORCE if self._forces else Capability.POSITION_LIMIT | Capability.STIFFNESS
        can |= Capability.STAMPS
        if self._kind is not Kind.BENDS:
            can |= Capability.SPLAY
        if self._kind is Kind.JOINTS:
            can |= Capability.JOINTS
        if first.battery >= 0:
            can |= Capability.BATTERY
        return GloveInfo(
            name=self._name,
            capabilities=can,
            channels=names[self._kind],
            hand=self._hand,
            unit="rad" if self._kind is Kind.JOINTS else "",
            doubtful=self._calibration.doubtful if calibrated else (),
            kept_free=self._calibration.kept_free if calibrated else (),
        )


def limited(force: FloatArray, most: float) -> FloatArray:
    """Shorten forces (5, 3) to at most `most` [N]; all 0 where one is not finite."""
    size = np.sqrt((force * force).sum(axis=1, keepdims=True))
    if not np.isfinite(size).all():
        return NO_FORCE
    return np.asarray(force * (most / np.maximum(size, most)))
