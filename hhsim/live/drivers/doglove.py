"""Driver of a DOGlove: reads 21 joints; sends nothing, since the command format of its servos is not published.

Sixteen encoders come from the main board, by a serial line or as datagrams; five servos give the knuckles' angles, as
datagrams. Each reading of the encoders makes a sample with the newest angles of the servos.
"""

import time
from collections import deque

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.live.device import UNKNOWN, Capability, DeviceCounters, DeviceError, FingerCommand, GloveDevice, GloveInfo
from hhsim.live.devices.doglove import DogloveOptions
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.link.doglove_codec import SERVOS, Encoders, FrameStream, decode_encoders, decode_servos
from hhsim.live.link.serial import SerialLink
from hhsim.live.link.udp import UdpPort

SILENCE_NS = 500_000_000
"""Silence of the encoders after which the glove counts as gone [ns]."""
SERVO_STALE_NS = 100_000_000
"""Age of the servos' angles from which on a sample is unusable [ns]."""
MOST_DEGREES = 180.0
DIP, PIP, SPLIT = np.array([0, 4, 7, 10, 13]), np.array([1, 5, 8, 11, 14]), np.array([2, 6, 9, 12, 15])
"""Indices of the encoders, thumb to little finger: joint next to the tip, the one before it, spread."""
CHANNELS = (
    *("thumb_dip", "thumb_pip", "thumb_split", "thumb_rotate"),
    *(f"{finger}_{joint}" for finger in ("index", "middle", "ring", "little") for joint in ("dip", "pip", "split")),
    *(f"{finger}_servo" for finger in ("thumb", "index", "middle", "ring", "little")),
)


class Doglove(GloveDevice):
    """One glove; InputError for an unknown baud rate, or zeros that are not five angles."""

    def __init__(self, config: GloveConfig) -> None:
        options = config.options
        assert isinstance(options, DogloveOptions)
        self._options = options
        self._zero = servo_zero(options.servo_zero)
        self._hand = config.hand
        where = options.path or f"udp port {options.port} from {options.host}"
        self._name = f"doglove at {where}, servos at udp port {options.port + 1}"
        self._line = SerialLink(options.path, options.baud, self._name) if options.path else None
        self._stream = FrameStream()
        self._encoders: UdpPort | None = None
        self._servos: UdpPort | None = None
        self._servo = np.full(SERVOS, np.nan)
        self._servo_ns = self._heard_ns = 0
        self._waiting: deque[tuple[Encoders, int]] = deque()
        self._reopened = 0
        self.counters = DeviceCounters()

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`; waits for a reading of the encoders and one of the servos."""
        self.close()
        options = self._options
        self._waiting.clear()
        self._servo_ns = 0
        try:
            self._servos = UdpPort(options.host, options.port + 1, decode_servos)
            if self._line is None:
                self._encoders = UdpPort(options.host, options.port, decode_encoders)
            else:
                self._stream.begin()
                self._line.connect(timeout)
            deadline = time.monotonic() + timeout
            while not (self._waiting and self._servo_ns):
                if time.monotonic() > deadline:
                    missing = "angle of the servos" if self._waiting else "reading of the encoders"
                    ports = [port for port in (self._encoders, self._servos) if port is not None]
                    hint = next(
                        (port.hint for port in ports if port.hint), "do its scripts run, and send to these ports?"
                    )
                    raise DeviceError(f"{self._name}: no {missing} came within {timeout:g} s: {hint}")
                time.sleep(0.002)
                self._receive()
        except DeviceError:
            self.close()
            raise
        self._heard_ns = time.monotonic_ns()
        can = Capability.JOINTS | Capability.SPLAY
        if self._line is not None:
            can |= Capability.STAMPS
        self.info = GloveInfo(self._name, can, CHANNELS, hand=self._hand, unit="deg")

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        self._receive()
        count = 0
        while self._waiting and count < len(samples_out):
            encoders, now = self._waiting.popleft()
            self._store(encoders, now, samples_out[count])
            count += 1
        now = time.monotonic_ns()
        if count:
            self._heard_ns = now
        elif now - self._heard_ns > SILENCE_NS:
            raise DeviceError(f"{self._name}: no reading of the encoders came for {1e-9 * SILENCE_NS:g} s")
        return count

    def descriptors(self) -> tuple[int, ...]:
        """See `GloveDevice.descriptors`."""
        ports = tuple(port.descriptor for port in (self._encoders, self._servos) if port is not None)
        return (*ports, self._line.descriptor()) if self._line is not None and self._line.connected else ports

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; sends nothing and counts nothing."""
        return True

    def release(self, timeout: float = 0.05) -> bool:
        """See `FingerRelease.release`; no finger was ever held."""
        return True

    def reconnect(self) -> bool:
        """See `GloveDevice.reconnect`; the glove is back with its next reading."""
        if self._line is not None and not self._line.connected:
            if not self._line.reconnect():
                return False
            self._stream.begin()
            self._reopened += 1
        try:
            self._receive()
        except DeviceError:
            return False
        if self._waiting:
            self._heard_ns = time.monotonic_ns()
        return bool(self._waiting)

    def close(self) -> None:
        """See `FingerRelease.close`."""
        for link in (self._encoders, self._servos, self._line):
            if link is not None:
                link.close()
        self._encoders = self._servos = None

    def _receive(self) -> None:
        if self._servos is None:
            raise DeviceError(f"{self._name}: not open")
        for servo, now in self._servos.arrived():
            self._servos.keep_to_sender()
            if np.isfinite(servo).all():
                self._servo, self._servo_ns = servo, now
        if self._line is None:
            assert self._encoders is not None
            for reading in self._encoders.arrived():
                self._encoders.keep_to_sender()
                self._waiting.append(reading)
        else:
            data = self._line.receive()
            now = time.monotonic_ns()
            self._waiting.extend((frame, now) for frame in self._stream.feed(data or b""))
        bad = self._stream.malformed + sum(port.malformed for port in (self._encoders, self._servos) if port)
        self.counters.malformed = bad
        self.counters.resyncs = self._reopened + self._stream.skipped
        self.counters.frames = self.counters.samples + self.counters.rejected + len(self._waiting) + bad

    def _store(self, encoders: Encoders, now: int, row: np.void) -> None:
        degrees, servo = encoders.degrees, self._servo
        flexion, abduction = hand_angles(degrees, servo - self._zero)
        fresh = now - self._servo_ns <= SERVO_STALE_NS
        good = fresh and bool(
            np.isfinite(degrees).all() and (np.abs(flexion) <= MOST_DEGREES).all() and (np.abs(abduction) <= 90.0).all()
        )
        stamp = 1_000_000 * encoders.milliseconds if encoders.milliseconds >= 0 else UNKNOWN
        angles = np.radians(flexion), np.radians(abduction)
        self._write_sample(row, now, good, np.concatenate([degrees, servo]), angles, device_time_ns=stamp)


def servo_zero(text: str) -> FloatArray:
    """Parse the servos' readings of a flat hand [deg], shape (5,); InputError for other than five angles."""
    try:
        zero = np.array([float(part) for part in text.split(",")])
    except ValueError:
        zero = np.zeros(0)
    if zero.shape != (SERVOS,) or not (np.abs(zero) <= 360.0).all():
        raise InputError(
            f"servo zero '{text}'; expected five numbers from -360 to 360 in degrees, with commas, thumb to little "
            "finger"
        )
    return zero


def hand_angles(encoders: FloatArray, bend: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute flexion (5, 3) and abduction (5,) of the hand; the thumb's rotation is not modelled. All in [deg].

    `encoders` are readings of the main board, shape (16,), `bend` the servos' angles relative to the flat hand, (5,).
    """
    flexion = np.stack([bend, 270.0 - encoders[PIP], encoders[DIP] - 90.0], axis=1)
    abduction = 180.0 - encoders[SPLIT]
    abduction[0] = -abduction[0]
    return flexion, abduction
