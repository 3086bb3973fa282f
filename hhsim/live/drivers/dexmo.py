"""Driver of a Dexmo glove at the TCP server of its vendor.

A server may have several gloves and clients. The driver picks one glove by its number or hand, and keeps it until it is
opened again. Forces cannot be commanded: each finger takes the bend at which it is stopped and a unitless stiffness.
"""

import contextlib
import math
import time
from collections import deque
from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import InputError
from hhsim.live.device import (
    FINGER_COUNT,
    GLOVE_SAMPLE,
    UNKNOWN,
    Capability,
    DeviceCounters,
    DeviceError,
    FingerCommand,
    GloveDevice,
    GloveInfo,
)
from hhsim.live.devices.dexmo import DexmoOptions
from hhsim.live.devices.registry import GloveConfig
from hhsim.live.link.dexmo_codec import (
    CHANNELS,
    FramingError,
    GloveMessage,
    MessageStream,
    WireError,
    decode_frame,
    encode_impedance,
    framed,
    message_classes,
)
from hhsim.live.link.tcp import TcpLink

if TYPE_CHECKING:
    from hhsim.live.drivers.calibration import GloveCalibration

FREE = (0.0,) * FINGER_COUNT
UNKNOWN_STIFFNESS = (1.0,) * FINGER_COUNT
"""Stiffness assumed at a new connection: the server may still apply an earlier command."""
SETTLE = 0.1
"""Time after the first glove in which others are searched for [s]."""
LEAST_SET_POINT = 1e-3
"""Least set point: its sign is its direction, which 0 would not have."""
MOST_MALFORMED = 20
"""Malformed frames in a row after which the framing counts as lost."""
MOST_KEPT = 1 << 20
"""Most bytes before the glove is found."""
MOST_FRAMES = 256
"""Most frames decoded in one call."""
HAND_TRUST_NS = 1_000_000_000
"""Time of frames of the right hand alone after which a glove that changed hands is used again [ns]."""


class DexmoGlove(GloveDevice):
    """One glove of a Dexmo server; its configuration has a `GloveCalibration` unless it is opened for release."""

    _calibration: "GloveCalibration"

    def __init__(self, config: GloveConfig) -> None:
        assert isinstance(config.options, DexmoOptions)
        message_classes()  # built here, not when the fingers are to be freed
        host, port, self._wanted_id = config.options.host, config.options.port, config.options.device_id
        self._configured = cast("GloveCalibration", config.calibration)
        self._hand = config.hand
        self._device_id: int | None = None
        self._link = TcpLink(host, port, f"dexmo at {host}:{port}")
        self._stream = MessageStream()
        self._waiting: deque[GloveMessage] = deque()
        self._received_ns = 0
        self._malformed_run = 0
        self._lost: DeviceError | None = None
        self._stiffness = list(UNKNOWN_STIFFNESS)
        self._battery = UNKNOWN
        self._other_hand = False
        self._ours_ns = -1
        self.counters = DeviceCounters()

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`; waits for a finite sample."""
        sample = self._find(timeout)
        assert sample.channels is not None
        try:
            self._fit(sample.channels)
        except InputError as error:
            self._link.close()
            raise DeviceError(f"{self._link.name}: {error}") from None

    def open_for_release(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open_for_release`; waits for the glove, without which no release can be sent."""
        self._find(timeout)

    def drain(self) -> None:
        """See `GloveDevice.drain`."""
        for _ in range(4):
            if self._link.receive() is None:
                return

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        if self._lost is None:
            try:
                data = self._link.receive()
            except DeviceError as error:
                # Frames received before the end are still returned.
                self._lost = error
            else:
                if data is not None:
                    self._received_ns = time.monotonic_ns()
                    self._stream.feed(data)
        count = 0
        for _ in range(MOST_FRAMES):
            while self._waiting and count < len(samples_out):
                count += self._store(self._waiting.popleft(), samples_out[count])
            if self._waiting or count == len(samples_out) or not self._next_frame():
                break
        if count == 0 and self._lost is not None and not self._waiting and not len(self._stream):
            raise self._lost
        return count

    def descriptors(self) -> tuple[int, ...]:
        """See `GloveDevice.descriptors`."""
        return (self._link.descriptor(),) if self._link.connected else ()

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; fingers of a command that is not finite are free."""
        if self._device_id is None:
            raise DeviceError(f"{self._link.name}: not open")
        stiffness, bend = command.stiffness.tolist(), command.bend.tolist()
        if all(map(math.isfinite, stiffness)) and all(map(math.isfinite, bend)):
            stiffness = [min(max(value, 0.0), 1.0) for value in stiffness]
            # From our calibrated range to the server's.
            set_point = [
                min(max(low + span * min(max(value, 0.0), 1.0), LEAST_SET_POINT), 1.0)
                for value, low, span in zip(bend, self._bend_open, self._bend_span)
            ]
        else:
            stiffness, set_point = list(FREE), list(FREE)
        # A command that frees a finger must be kept; others are replaced within a tick, and would only queue up.
        kept = any(now < before for now, before in zip(stiffness, self._stiffness))
        if not self._link.send(framed(encode_impedance(self._device_id, stiffness, set_point, kept=kept))):
            self.counters.commands_refused += 1
            return False
        self._stiffness = stiffness
        self.counters.commands += 1
        return True

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`; opens a fresh connection where this one takes nothing."""
        if self._device_id is None:
            return False
        before = self._link.connection
        sent = self._link.send_within(framed(encode_impedance(self._device_id, FREE, FREE, kept=True)), timeout)
        if self._link.connection != before:
            self._begin_stream()
        if sent:
            self._stiffness = list(FREE)
            self.counters.commands += 1
        return sent

    def reconnect(self) -> bool:
        """See `GloveDevice.reconnect`; does not wait for a sample."""
        if self._lost is None and self._link.connected and not self._other_hand:
            return True
        if not self._link.reconnect():
            return False
        if self._lost is not None or not self._other_hand:
            self._begin_stream()
            if self._other_hand:
                # The previous connection may have refused the release.
                self._free_fingers()
        return not self._other_hand or self._our_hand_again()

    def close(self) -> None:
        """See `GloveDevice.close`."""
        self._link.close()

    def _fit(self, channels: Sequence[float]) -> None:
        """Select the calibration for the channels that the glove sends, and set `info`."""
        self._calibration = calibration = self._configured.fitting(channels)
        counted = calibration.counted
        # A server that sends counts still takes set points from 0 to 1.
        low, high = (np.zeros(FINGER_COUNT), np.ones(FINGER_COUNT)) if counted else calibration.bend_ends()
        self._bend_open, self._bend_span = low.tolist(), (high - low).tolist()
        self._flexion, self._abduction = calibration.regression.angles(calibration.regression.open)
        self.info = GloveInfo(
            name=self._link.name,
            capabilities=Capability.POSITION_LIMIT | Capability.STIFFNESS | Capability.SPLAY | Capability.BATTERY,
            channels=CHANNELS,
            hand=self._hand,
            unit="count" if counted else "",
            doubtful=calibration.doubtful,
            kept_free=calibration.kept_free,
        )

    def _find(self, timeout: float) -> GloveMessage:
        """Connect and wait for a finite sample of the glove; received bytes are kept for `read`."""
        deadline = time.monotonic() + timeout
        self._link.connect(timeout)
        self._begin_stream(resyncs=0)
        self._waiting.clear()
        self._device_id = None
        self._other_hand = False
        probe = MessageStream()
        seen: dict[int, GloveMessage] = {}
        settled = deadline
        try:
            while (now := time.monotonic()) < min(deadline, settled):
                data = self._link.receive()
                if data is None:
                    self._link.wait(min(deadline, settled) - now)
                    continue
                self._received_ns = time.monotonic_ns()
                self._stream.feed(data)
                if len(self._stream) > MOST_KEPT:
                    raise FramingError(f"more than {MOST_KEPT >> 20} MB without its glove")
                probe.feed(data)
                while (payload := probe.next()) is not None:
                    for message in decode_frame(payload):
                        if message.channels is not None and all(map(math.isfinite, message.channels)):
                            seen[message.device_id] = message
                if self._wanted_id in seen:
                    break
                if self._wanted_id is None and settled == deadline and self._candidates(seen):
                    settled = time.monotonic() + SETTLE
        except (FramingError, WireError) as error:
            self._link.close()
            raise DeviceError(f"{self._link.name}: what answers there is no Dexmo server: {error}") from None
        return self._chosen(seen, timeout)

    def _candidates(self, seen: dict[int, GloveMessage]) -> list[GloveMessage]:
        """Return the gloves of our hand; without any, those of unknown hand."""
        wanted = self._hand == "right"
        ours = [message for message in seen.values() if message.right is wanted]
        return ours or [message for message in seen.values() if message.right is None]

    def _chosen(self, seen: dict[int, GloveMessage], timeout: float) -> GloveMessage:
        number = self._wanted_id
        if number is None:
            found, wanted = self._candidates(seen), f"{self._hand} glove"
        else:
            found, wanted = [seen[number]] if number in seen else [], f"glove {number}"
        if len(found) == 1 and found[0].right in (None, self._hand == "right"):
            self._device_id = found[0].device_id
            return found[0]
        self._link.close()
        sides = {True: "right", False: "left", None: "hand not said"}
        there = ", ".join(f"{message.device_id} ({sides[message.right]})" for message in seen.values()) or "none"
        if found and number is not None:
            raise DeviceError(f"{self._link.name}: {wanted} is not a {self._hand} hand's")
        if found:
            raise DeviceError(f"{self._link.name} has {len(found)} {wanted}s: {there}; name one by its number")
        raise DeviceError(f"{self._link.name}: no {wanted} within {timeout:g} s; gloves there: {there}")

    def _begin_stream(self, resyncs: int = 1) -> None:
        """Reset the state of the connection: a new one begins with a new message."""
        self._stream, self._lost, self._malformed_run = MessageStream(), None, 0
        self._stiffness = list(UNKNOWN_STIFFNESS)
        self.counters.resyncs += resyncs

    def _next_frame(self) -> bool:
        """Decode one frame into `_waiting`; False where there is none."""
        try:
            payload = self._stream.next()
        except FramingError as error:
            self._let_go(f"the stream from its server makes no sense: {error}")
            return False
        if payload is None:
            if self._lost is not None:
                self._stream = MessageStream()
            return False
        self.counters.frames += 1
        try:
            messages = decode_frame(payload)
        except WireError as error:
            self.counters.malformed += 1
            self._malformed_run += 1
            if self._malformed_run >= MOST_MALFORMED:
                self._let_go(f"{self._malformed_run} frames in a row cannot be read: {error}")
                return False
            return True
        self._malformed_run = 0
        if messages:
            self._waiting.extend(messages)
        else:
            self.counters.other += 1
        return True

    def _let_go(self, reason: str) -> None:
        """Free the fingers and end an unusable connection."""
        self._free_fingers()
        self._link.retire()
        self._stream = MessageStream()
        self._waiting.clear()
        self._lost = DeviceError(f"{self._link.name}: {reason}")

    def _free_fingers(self) -> None:
        """Send a release without waiting, where there is a glove."""
        with contextlib.suppress(DeviceError):
            if self._device_id is not None:
                self._link.send(framed(encode_impedance(self._device_id, FREE, FREE, kept=True)), urgent=True)

    def _our_hand_again(self) -> bool:
        """Discard what came; True if the glove has been of our hand for `HAND_TRUST_NS`."""
        try:
            self.read(np.zeros(1, GLOVE_SAMPLE))
        except DeviceError:
            self._ours_ns = -1
        if self._ours_ns < 0 or self._received_ns - self._ours_ns < HAND_TRUST_NS:
            return False
        self._other_hand = False
        return True

    def _is_of_our_hand(self, message: GloveMessage) -> bool:
        """True if our glove's samples can be used; a glove that changes hands is lost."""
        if message.right not in (None, self._hand == "right"):
            self._ours_ns = -1
            if not self._other_hand:
                self._other_hand = True
                now = "left" if self._hand == "right" else "right"
                self._let_go(
                    f"glove {self._device_id} says that it is a {now} hand's now, and not a {self._hand} one's"
                )
        elif self._other_hand and self._ours_ns < 0:
            self._ours_ns = self._received_ns
        return not self._other_hand

    def _store(self, message: GloveMessage, row: np.void) -> int:
        """Write a sample and return 1, or 0 for a message without one of our glove."""
        ours = message.device_id == self._device_id and self._is_of_our_hand(message)
        if not ours or message.channels is None:
            self.counters.other += 1
            return 0
        if message.battery is not None:
            self._battery = message.battery if 0 <= message.battery <= 100 else UNKNOWN
        readings = np.array(message.channels)
        # Python's loop is faster than numpy's on eleven numbers with cold caches.
        found = self._calibration.angles(readings) if all(map(math.isfinite, message.channels)) else None
        good = found is not None
        if found is not None:
            self._flexion, self._abduction = found
        angles = self._flexion, self._abduction
        self._write_sample(row, self._received_ns, good, readings, angles, battery=self._battery)
        return 1
