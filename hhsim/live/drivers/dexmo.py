"""Driver of a Dexmo glove at the TCP server of its vendor.

A server may have several gloves and clients. The driver picks one glove by its number or hand, and keeps it until it is
opened again. Forces cannot be commanded: each finger takes the bend at which it is stopped and a unitless stiffness.
"""

import contextlib
import itertools
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
from hhsim.live.link import dexmo_codec
from hhsim.live.link.tcp import TcpLink

if TYPE_CHECKING:
    from hhsim.live.drivers.calibration import GloveCalibration

MOST_MESSAGES = 256
"""Most messages read in one call, so that a flood cannot delay the driver."""
MOST_MALFORMED = 20
"""Malformed messages in a row that count as lost framing."""
FREE = (0.0,) * FINGER_COUNT
UNKNOWN_STIFFNESS = (1.0,) * FINGER_COUNT
"""Stiffness assumed at a new connection: the server may still apply an earlier command."""
SETTLE = 0.1
"""Time after the first glove in which others are searched for [s]."""
LEAST_SET_POINT = 1e-3
"""Least set point: its sign is its direction, which 0 would not have."""
MOST_KEPT = 1 << 20
"""Most bytes before the glove is found."""


class DexmoGlove(GloveDevice):
    """One glove of a Dexmo server; its configuration has a `GloveCalibration` unless it is opened for release."""

    _calibration: "GloveCalibration"

    def __init__(self, config: GloveConfig) -> None:
        assert isinstance(config.options, DexmoOptions)
        dexmo_codec.message_classes()  # built here, not when the fingers are to be freed
        host, port, self._wanted_id = config.options.host, config.options.port, config.options.device_id
        self._link = TcpLink(host, port, f"dexmo at {host}:{port}")
        self._connection = 0
        # Whole frames that were not read yet, each with CLOCK_MONOTONIC of its last byte [ns].
        self._waiting: deque[tuple[bytes, int]] = deque()
        self._lost: DeviceError | None = None  # reason why the glove is gone; None while it is there
        self._malformed_run = 0
        self.counters = DeviceCounters()
        self._configured = cast("GloveCalibration", config.calibration)
        self._hand = config.hand
        self._device_id: int | None = None
        self._battery = UNKNOWN
        self._stiffness = list(UNKNOWN_STIFFNESS)
        self._other_hand = False

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
        self._link.drain()

    def read(self, samples_out: NDArray[np.void]) -> int:
        """See `GloveDevice.read`."""
        if self._lost is None:
            try:
                self._receive()
            except DeviceError as error:
                # Messages received before the end are still read.
                self._lost = error
        count = 0
        for _ in range(MOST_MESSAGES):
            if not self._waiting or count == len(samples_out):
                break
            count += self._store(*self._waiting.popleft(), samples_out[count])
        if count == 0 and self._lost is not None and not self._waiting:
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
        sent = self._send(
            dexmo_codec.framed(dexmo_codec.encode_impedance(self._device_id, stiffness, set_point, kept=kept))
        )
        if sent:
            self._stiffness = stiffness
        return sent

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`; opens a fresh connection where this one takes nothing."""
        if self._device_id is None:
            return False
        sent = self._link.send_within(self._release_message(), timeout)
        self._renew()
        self.counters.commands += sent
        if sent:
            self._stiffness = list(FREE)
        return sent

    def reconnect(self) -> bool:
        """See `GloveDevice.reconnect`; does not wait for a sample."""
        if not self._link.reconnect():
            return False
        self._lost = None
        self._renew()
        return True

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
            channels=dexmo_codec.CHANNELS,
            hand=self._hand,
            unit="count" if counted else "",
            doubtful=calibration.doubtful,
            kept_free=calibration.kept_free,
        )

    def _find(self, timeout: float) -> dexmo_codec.GloveMessage:
        """Connect and wait for a finite sample of the glove; received frames are kept for `read`."""
        deadline = time.monotonic() + timeout
        self._connect(timeout)
        self._device_id = None
        self._other_hand = False
        seen: dict[int, dexmo_codec.GloveMessage] = {}
        settled, received, looked_at = deadline, 0, 0
        try:
            while (now := time.monotonic()) < min(deadline, settled):
                self._link.wait(min(deadline, settled) - now)
                received += self._take_bytes()
                if received > MOST_KEPT:
                    raise dexmo_codec.FramingError(f"more than {MOST_KEPT >> 20} MB without its glove")
                for frame, _ in itertools.islice(self._waiting, looked_at, None):
                    for message in dexmo_codec.decode_frame(frame):
                        if message.channels is not None and all(map(math.isfinite, message.channels)):
                            seen[message.device_id] = message
                looked_at = len(self._waiting)
                if self._wanted_id in seen:
                    break
                if self._wanted_id is None and settled == deadline and self._candidates(seen):
                    settled = time.monotonic() + SETTLE
        except (dexmo_codec.FramingError, dexmo_codec.WireError) as error:
            self._link.close()
            raise DeviceError(f"{self._link.name}: what answers there is no Dexmo server: {error}") from None
        return self._chosen(seen, timeout)

    def _candidates(self, seen: dict[int, dexmo_codec.GloveMessage]) -> list[dexmo_codec.GloveMessage]:
        """Return the gloves of our hand; without any, those of unknown hand."""
        wanted = self._hand == "right"
        ours = [message for message in seen.values() if message.right is wanted]
        return ours or [message for message in seen.values() if message.right is None]

    def _chosen(self, seen: dict[int, dexmo_codec.GloveMessage], timeout: float) -> dexmo_codec.GloveMessage:
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

    def _begin_stream(self) -> None:
        self._stream = dexmo_codec.MessageStream()
        self._stiffness = list(UNKNOWN_STIFFNESS)

    def _connect(self, timeout: float) -> None:
        """Connect within `timeout` [s], and forget what came before; raises DeviceError if there is no glove."""
        self._link.connect(timeout)
        self._connection = self._link.connection
        self._waiting.clear()
        self._lost, self._malformed_run = None, 0
        self._begin_stream()

    def _renew(self) -> None:
        """Begin the stream anew if the link has a new connection."""
        if self._link.connection != self._connection:
            self._connection = self._link.connection
            self._lost, self._malformed_run = None, 0
            self._begin_stream()
            self.counters.resyncs += 1

    def _take_bytes(self) -> int:
        """Cut what has arrived into `_waiting`; returns how many bytes that was."""
        data = self._link.receive() or b""
        now = time.monotonic_ns()
        self._stream.feed(data)
        while (frame := self._stream.next()) is not None:
            self._waiting.append((frame, now))
        return len(data)

    def _send(self, data: bytes) -> bool:
        """Send a command, and count it."""
        if self._link.send(data):
            self.counters.commands += 1
            return True
        self.counters.commands_refused += 1
        return False

    def _receive(self) -> None:
        try:
            self._take_bytes()
        except dexmo_codec.FramingError as error:
            self._give_up(f"the stream from its server makes no sense: {error}")

    def _give_up(self, reason: str) -> None:
        """Free the fingers and end an unusable connection."""
        self._free_fingers()
        self._link.retire()
        self._waiting.clear()
        self._lost = DeviceError(f"{self._link.name}: {reason}")

    def _free_fingers(self) -> None:
        """Send a release without waiting, where there is a glove."""
        with contextlib.suppress(DeviceError):
            if self._device_id is not None:
                self._link.send(self._release_message(), urgent=True)

    def _release_message(self) -> bytes:
        assert self._device_id is not None
        return dexmo_codec.framed(dexmo_codec.encode_impedance(self._device_id, FREE, FREE, kept=True))

    def _is_of_our_hand(self, glove: dexmo_codec.GloveMessage) -> bool:
        """True if our glove's samples can be used; the first of the other hand frees the fingers and is an error."""
        ours = glove.right in (None, self._hand == "right")
        if not ours and not self._other_hand:
            self._free_fingers()
            now = "left" if self._hand == "right" else "right"
            reason = f"glove {self._device_id} says that it is a {now} hand's now, and not a {self._hand} one's"
            self._lost = DeviceError(f"{self._link.name}: {reason}")
        self._other_hand = not ours
        return ours

    def _store(self, message: bytes, now: int, row: np.void) -> int:
        self.counters.frames += 1
        try:
            gloves = dexmo_codec.decode_frame(message)
        except dexmo_codec.WireError as error:
            self.counters.malformed += 1
            self._malformed_run += 1
            if self._malformed_run >= MOST_MALFORMED:
                self._give_up(f"{self._malformed_run} frames in a row cannot be read: {error}")
            return 0
        self._malformed_run = 0
        glove = next((glove for glove in gloves if glove.device_id == self._device_id), None)
        if glove is None or not self._is_of_our_hand(glove) or glove.channels is None:
            self.counters.other += 1
            return 0
        if glove.battery is not None:
            self._battery = glove.battery if 0 <= glove.battery <= 100 else UNKNOWN
        readings = np.array(glove.channels)
        # Python's loop is faster than numpy's on eleven numbers with cold caches.
        found = self._calibration.angles(readings) if all(map(math.isfinite, glove.channels)) else None
        if found is not None:
            self._flexion, self._abduction = found
        angles = self._flexion, self._abduction
        self._write_sample(row, now, found is not None, readings, angles, battery=self._battery)
        return 1
