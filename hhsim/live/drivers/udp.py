"""Driver of any glove, or hand that a headset tracks, through a bridge that speaks `hhsim.live.open_packet`.

Order and frames of a tracked hand's joints are those of XR_EXT_hand_tracking (OpenXR 1.1).
"""

import contextlib
import math
import os
import socket
import time
from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.live.device import (
    FINGER_COUNT,
    FORCES,
    LIMITS,
    UNKNOWN,
    DeviceCounters,
    DeviceError,
    FingerCommand,
    GloveDevice,
    GloveInfo,
    PalmReading,
)
from hhsim.live.gloves import GLOVES, GloveConfig, PacketOptions
from hhsim.live.open_packet import NONE_YET, Kind, Packet, UdpPort, encode_packet, resolve

if TYPE_CHECKING:
    from hhsim.live.drivers.tracked_hand import TrackedHand

SILENCE_NS = 500_000_000
"""Silence after which a bridge counts as gone [ns]; the fingers are free long before."""
RELEASE_COPIES = 3
"""Datagrams a release is sent in, as one may be lost."""
MOST_ANGLE = 2.0 * math.pi
MOST_BEYOND = 1.0
"""Largest difference of a hand's bend from 0.5."""
NO_LIMIT = np.zeros(10)
NO_FORCE = np.zeros((FINGER_COUNT, 3))


class UdpGlove(GloveDevice):
    """Glove of a bridge that takes limits of fingers or forces on tips.

    Samples arrive at its port, and commands go to the next one. Samples are used in the order of their sequence
    numbers; late ones are left out and counted. The first packet sets the kind of numbers that the bridge sends: of a
    glove that gives the palm the joints of a hand, else bends or angles.
    """

    _tracked: "TrackedHand"

    def __init__(self, config: GloveConfig) -> None:
        options = config.options
        assert isinstance(options, PacketOptions)
        self._config, self._options = config, options
        self._name = f"{config.kind} bridge at {options.host}, samples to port {options.port}"
        self._kinds: tuple[Kind, ...] = ()
        self.palm = PalmReading() if GLOVES[config.kind].palm else None
        self.counters = DeviceCounters()
        self._port: UdpPort | None = None
        self._out: socket.socket | None = None
        self._target = ("", 0)
        self._session = int.from_bytes(os.urandom(4), "little")
        self._sent, self._answers = 0, NONE_YET
        self._waiting: deque[tuple[Packet, int]] = deque()
        self._heard_ns = 0
        self._angles = np.zeros((FINGER_COUNT, 3)), np.zeros(FINGER_COUNT)

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`; waits for the first sample."""
        # A release alone needs none of these.
        from hhsim.recordings.column_map import JOINT_NAMES
        from hhsim.recordings.dexmo_regression import DexmoRegression
        from hhsim.recordings.joint_names import KEYPOINTS

        usual = DexmoRegression.default()
        self._slope, self._offset = usual.bend_lines()
        self._angles = self._offset, usual.offset[15:]
        if self.palm is not None:
            from hhsim.live.drivers.tracked_hand import TrackedHand

            self._tracked = TrackedHand(self._config.hand)
        self.open_for_release(timeout)
        self._waiting.clear()
        self._kinds = (Kind.BENDS, Kind.JOINTS) if self.palm is None else (Kind.HAND,)
        try:
            self._port = UdpPort(self._options.host, self._options.port, self.counters)
        except DeviceError:
            self.close()
            raise
        deadline = time.monotonic() + timeout
        while not self._waiting:
            left = deadline - time.monotonic()
            if left <= 0.0:
                hint = self._port.hint or "is the bridge running, and does it send to that port?"
                self.close()
                raise DeviceError(f"{self._name}: no sample came within {timeout:g} s: {hint}")
            self._port.wait(left)
            self._receive(1)
        kind = self._waiting[0][0].kind
        self._kinds = (kind,)
        channels, unit = {
            Kind.BENDS: (tuple(f"{finger}_bend" for finger in FINGERS), ""),
            Kind.JOINTS: (JOINT_NAMES, "rad"),
            Kind.HAND: (tuple(f"{name}_{axis}" for name in KEYPOINTS for axis in "xyz"), "m"),
        }[kind]
        capabilities = FORCES if self._options.takes == "forces" else LIMITS
        self.info = GloveInfo(self._name, channels, capabilities, self._config.hand, unit)

    def open_for_release(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open_for_release`; the port of the samples stays with the loop."""
        self.close()
        self._target = (resolve(self._options.host), self._options.port + 1)
        self._out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._out.setblocking(False)

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        if self._port is None:
            raise DeviceError(f"{self._name}: not open")
        self._receive(len(samples_out) - len(self._waiting))
        count = 0
        while self._waiting and count < len(samples_out):
            packet, now = self._waiting.popleft()
            values = packet.values.astype(np.float64)
            good = self._take(values, now)
            self._answers = packet.seq
            self._write_sample(
                samples_out[count],
                now,
                good,
                values if self.palm is None else self._tracked.joints.ravel(),
                self._angles,
                device_time_ns=packet.t_ns if packet.t_ns < 2**63 else UNKNOWN,
                device_seq=packet.seq,
                battery=packet.battery if 0 <= packet.battery <= 100 else UNKNOWN,
            )
            count += 1
        if count == 0 and time.monotonic_ns() - self._heard_ns > SILENCE_NS:
            hint = self._port.hint
            what = "no sample" if hint else "nothing"
            raise DeviceError(f"{self._name}: {what} came for {1e-9 * SILENCE_NS:g} s{hint and ': '}{hint}")
        return count

    def descriptors(self) -> tuple[int, ...]:
        """See `GloveDevice.descriptors`."""
        return () if self._port is None else (self._port.descriptor,)

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; fingers of a command that is not finite are free."""
        sent = self._send(command)
        self.counters.commands_refused += not sent
        return sent

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`."""
        sent = False
        for _ in range(RELEASE_COPIES):
            with contextlib.suppress(DeviceError):
                sent = self._send(FingerCommand()) or sent
        return sent

    def reconnect(self) -> bool:
        """See `GloveDevice.reconnect`; the bridge is back with its next sample."""
        if self._port is None:
            return self._out is not None
        if not self._waiting:
            self._receive(1)
        return bool(self._waiting)

    def close(self) -> None:
        """See `GloveDevice.close`."""
        for end in (self._port, self._out):
            if end is not None:
                end.close()
        self._port = self._out = None

    def _send(self, command: FingerCommand) -> bool:
        if self._out is None:
            raise DeviceError(f"{self._name}: not open")
        if self._options.takes == "forces":
            kind, numbers = Kind.FORCES, limited(command.force[:, 2], self._options.most_force)
        else:
            told = np.concatenate([command.bend, command.stiffness])
            kind, numbers = Kind.COMMAND, np.clip(told, 0.0, 1.0) if np.isfinite(told).all() else NO_LIMIT
        stamp = time.monotonic_ns()
        data = encode_packet(kind, numbers, session=self._session, seq=self._sent, t_ns=stamp, answers=self._answers)
        try:
            self._out.sendto(data, self._target)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError as error:
            raise DeviceError(f"{self._name}: cannot send: {error.strerror or error}") from None
        self._sent += 1
        self.counters.commands += 1
        return True

    def _receive(self, most: int) -> None:
        """Take at most so many samples of what has arrived."""
        assert self._port is not None
        for packet, now in self._port.read(most, self._kinds):
            self._waiting.append((packet, now))
            self._heard_ns = now

    def _take(self, values: FloatArray, now_ns: int) -> bool:
        """Set the angles, and the palm, from a sample's numbers; False beyond a hand's range."""
        if self.palm is not None:
            fit = self._tracked
            if not fit.take(values):
                return False
            self._angles = fit.flexion, fit.abduction
            self.palm.position[:], self.palm.orientation[:], self.palm.came_ns = fit.position, fit.orientation, now_ns
            return True
        # NaN compares false.
        if self._kinds == (Kind.JOINTS,):
            usable = bool((np.abs(values) <= MOST_ANGLE).all())
            found = values[:15].reshape(FINGER_COUNT, 3), values[15:]
        else:
            usable = bool((np.abs(values - 0.5) <= MOST_BEYOND).all())
            found = self._offset + values[:, None] * self._slope, self._angles[1]
        if usable:
            self._angles = found
        return usable


def limited(force: FloatArray, most: float) -> FloatArray:
    """Shorten forces (5, 3) to at most `most` [N]; all 0 where one is not finite."""
    size = np.sqrt((force * force).sum(axis=1, keepdims=True))
    if not np.isfinite(size).all():
        return NO_FORCE
    return np.asarray(force * (most / np.maximum(size, most)))
