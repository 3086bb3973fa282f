"""Driver of a Dexmo glove at the TCP server of its vendor, and the messages between that and its clients.

Both ways: the length of a message as a little-endian int32, then the message in proto3. The server sends `Frame`, the
client `Command`. Field numbers and meanings are those of the vendor's example client for its Linux server 1.1.6, names
are ours; unused fields of a command (rumble, other) are skipped. A frame has neither a stamp nor a number nor a force.

A server may have several gloves and clients. The driver picks one glove by its number or hand, and keeps it until it is
opened again. Forces cannot be commanded: each finger takes the bend at which it is stopped and a unitless stiffness.
"""

import contextlib
import math
import struct
import time
from collections import deque
from collections.abc import Sequence
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import HhsimError
from hhsim.live.device import (
    FINGER_COUNT,
    LIMITS,
    UNKNOWN,
    DeviceCounters,
    DeviceError,
    FingerCommand,
    GloveDevice,
    GloveInfo,
)
from hhsim.live.gloves import DexmoOptions, GloveConfig
from hhsim.live.tcp import TcpLink

if TYPE_CHECKING:
    from hhsim.recordings.dexmo_regression import DexmoRegression

CHANNELS = (
    *("thumb_rotate", "thumb_split", "thumb_bend", "index_split", "index_bend", "middle_split", "middle_bend"),
    *("ring_split", "ring_bend", "pinky_split", "pinky_bend"),
)
"""Channels of a hand in the order of their field numbers, 3 to 13; pinky is the little finger."""
FINGER_FIELDS = ("thumb", "index", "middle", "ring", "pinky")

MESSAGES = {
    "Hand": [(number, name, "float") for number, name in enumerate(CHANNELS, start=3)],
    "Device": [(2, "is_right", "bool"), (3, "battery_percent", "int32")],
    "FrameMessage": [(1, "id", "int32"), (2, "hand", "Hand"), (3, "device", "Device")],
    "Frame": [(1, "frame_len", "int32"), (2, "messages", "*FrameMessage")],
    "ImpedanceData": [(1, "stiffness", "float"), (2, "set_point", "float")],
    "Impedance": [*((k, f, "ImpedanceData") for k, f in enumerate(FINGER_FIELDS, start=1)), (6, "has_index", "bool")],
    "Command": [(1, "id", "int32"), (2, "impedance", "*Impedance")],
}
"""Number, name and type of each field; a star marks a repeated message."""

MOST_BYTES = 8192
"""Longest message [bytes]; a glove takes about 80. A longer one means that the framing is lost."""
LENGTH = struct.Struct("<i")
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

_channels = attrgetter(*CHANNELS)


class WireError(HhsimError):
    """Bytes that are no message, or a length of none: then the framing is lost until a new connection."""


class GloveMessage(NamedTuple):
    """Data of one glove in a frame."""

    device_id: int
    # Values in the order of `CHANNELS`, None without hand data; they may be NaN or infinite.
    channels: tuple[float, ...] | None = None
    right: bool | None = None  # True for a right hand, None if unknown
    battery: int | None = None  # charge [%], None if unknown


@cache
def message_classes() -> dict[str, Any]:
    """Return the protobuf class of each of `MESSAGES`; the first call imports protobuf, which takes some 50 ms."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    proto = descriptor_pb2.FieldDescriptorProto
    scalars = {"float": proto.TYPE_FLOAT, "int32": proto.TYPE_INT32, "bool": proto.TYPE_BOOL}
    file = descriptor_pb2.FileDescriptorProto(name="dexmo.proto", package="dexmo", syntax="proto3")
    for name, fields in MESSAGES.items():
        message = file.message_type.add(name=name)
        for number, field, kind in fields:
            added = message.field.add(name=field, number=number)
            added.label = proto.LABEL_REPEATED if kind.startswith("*") else proto.LABEL_OPTIONAL
            added.type = scalars.get(kind, proto.TYPE_MESSAGE)
            if kind not in scalars:
                added.type_name = f".dexmo.{kind.lstrip('*')}"
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    return {name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"dexmo.{name}")) for name in MESSAGES}


def framed(payload: bytes) -> bytes:
    """Return a message with its length before it."""
    return LENGTH.pack(len(payload)) + payload


def next_message(waiting: bytearray) -> bytes | None:
    """Take the next message off what has arrived; None until it is whole, WireError for a length of none."""
    if len(waiting) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack_from(waiting)
    if not 0 <= length <= MOST_BYTES:
        raise WireError(f"a message of {length} bytes: expected 0 to {MOST_BYTES}")
    end = LENGTH.size + length
    if end > len(waiting):
        return None
    message = bytes(waiting[LENGTH.size : end])
    del waiting[:end]
    return message


def parse_message(name: str, payload: bytes) -> Any:
    """Parse one of `MESSAGES`; raises WireError if it is none."""
    from google.protobuf.message import DecodeError

    try:
        return message_classes()[name].FromString(payload)
    except DecodeError:
        raise WireError(f"{len(payload)} bytes that are no {name}") from None


def decode_frame(payload: bytes) -> list[GloveMessage]:
    """Return the gloves of a frame; raises WireError if it is none."""
    found = []
    for message in parse_message("Frame", payload).messages:
        channels = _channels(message.hand) if message.HasField("hand") else None
        told = (message.device.is_right, message.device.battery_percent) if message.HasField("device") else ()
        found.append(GloveMessage(message.id, channels, *told))
    return found


def encode_impedance(device_id: int, stiffness: Sequence[float], set_point: Sequence[float], *, kept: bool) -> bytes:
    """Encode a command to the fingers of one glove, thumb to little finger, with its length.

    `stiffness` is 0 (free) to 1, `set_point` the bend at which a force begins, 0 to 1, positive against closing,
    negative against opening. The server may not drop a `kept` command for a newer one (has_index).
    """
    fingers = zip(FINGER_FIELDS, stiffness, set_point, strict=True)
    commands = {name: {"stiffness": hard, "set_point": place} for name, hard, place in fingers}
    command = message_classes()["Command"](id=device_id, impedance=[{"has_index": kept, **commands}])
    return framed(command.SerializeToString())


def glove_calibration(options: DexmoOptions, hand: str) -> "DexmoRegression":
    """Return the calibration that a glove's settings name, or the default; either hand has the same channels.

    InputError for a file that is unreadable or malformed.
    """
    from hhsim.recordings.dexmo_regression import DexmoRegression, read_calibration

    return read_calibration(Path(options.calibration)) if options.calibration else DexmoRegression.default()


class DexmoGlove(GloveDevice):
    """One glove of a Dexmo server; its configuration has a `DexmoRegression` unless it is opened for release."""

    _lost: DeviceError | None  # reason why the glove is gone; None while it is there
    _stiffness: list[float]

    def __init__(self, config: GloveConfig) -> None:
        assert isinstance(config.options, DexmoOptions)
        message_classes()  # built here, not when the fingers are to be freed
        host, port, self._wanted_id = config.options.host, config.options.port, config.options.device_id
        self._link = TcpLink(host, port, f"dexmo at {host}:{port}")
        # Whole frames that were not read yet, each with CLOCK_MONOTONIC of its last byte [ns].
        self._waiting: deque[tuple[bytes, int]] = deque()
        self.counters = DeviceCounters()
        self._calibration = cast("DexmoRegression", config.calibration)
        self._hand = config.hand
        self._device_id: int | None = None
        self._battery = UNKNOWN
        self._other_hand = False
        self._begin_stream()

    def open(self, timeout: float = 5.0) -> None:
        """See `GloveDevice.open`; waits for a finite sample."""
        self._find(timeout)
        self.describe()

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
                self._take_bytes()
            except WireError as error:
                self._give_up(f"the stream from its server makes no sense: {error}")
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
        return self._link.descriptors()

    def send(self, command: FingerCommand) -> bool:
        """See `GloveDevice.send`; fingers of a command that is not finite are free."""
        if self._device_id is None:
            raise DeviceError(f"{self._link.name}: not open")
        stiffness, bend = command.stiffness.tolist(), command.bend.tolist()
        if all(map(math.isfinite, [*stiffness, *bend])):
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
        sent = self._link.send(encode_impedance(self._device_id, stiffness, set_point, kept=kept))
        if sent:
            self._stiffness = stiffness
        self.counters.commands += sent
        self.counters.commands_refused += not sent
        return sent

    def release(self, timeout: float = 0.05) -> bool:
        """See `GloveDevice.release`; opens a fresh connection where this one takes nothing."""
        if self._device_id is None:
            return False
        sent = self._link.send_within(encode_impedance(self._device_id, FREE, FREE, kept=True), timeout)
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

    def describe(self) -> None:
        """Set `info`, and what follows from the calibration."""
        # A release alone does not need it.
        from hhsim.recordings.dexmo_regression import BEND

        calibration = self._calibration
        counted = calibration.in_counts
        # A server that sends counts still takes set points from 0 to 1.
        low, high = (np.zeros(11), np.ones(11)) if counted else (calibration.open, calibration.closed)
        self._bend_open, self._bend_span = low[BEND].tolist(), (high - low)[BEND].tolist()
        self._angles = calibration.angles(calibration.open)
        doubtful, kept_free = calibration.doubtful()
        self.info = GloveInfo(
            name=self._link.name,
            channels=CHANNELS,
            capabilities=LIMITS,
            hand=self._hand,
            unit="count" if counted else "",
            doubtful=doubtful,
            kept_free=kept_free,
        )

    def _find(self, timeout: float) -> None:
        """Connect, and read frames until one has finite channels of the glove; they are counted as others."""
        deadline, settled = time.monotonic() + timeout, False
        self._link.connect(timeout)
        self._waiting.clear()
        self._begin_stream()
        self._device_id, self._other_hand = None, False
        seen: dict[int, GloveMessage] = {}
        try:
            while self._wanted_id not in seen and (left := deadline - time.monotonic()) > 0.0:
                self._link.wait(left)
                self._take_bytes()
                while self._waiting:
                    self.counters.frames += 1
                    self.counters.other += 1
                    for message in decode_frame(self._waiting.popleft()[0]):
                        if message.channels is not None and all(map(math.isfinite, message.channels)):
                            seen[message.device_id] = message
                if self._wanted_id is None and not settled and self._candidates(seen):
                    deadline, settled = min(deadline, time.monotonic() + SETTLE), True
        except WireError as error:
            self._link.close()
            raise DeviceError(f"{self._link.name}: what answers there is no Dexmo server: {error}") from None
        found = self._candidates(seen)
        if len(found) == 1 and self._is_ours(found[0]):
            self._device_id = found[0].device_id
            return
        self._link.close()
        sides = {True: "right", False: "left", None: "hand not said"}
        there = ", ".join(f"{message.device_id} ({sides[message.right]})" for message in seen.values()) or "none"
        wanted = f"{self._hand} glove" if self._wanted_id is None else f"glove {self._wanted_id}"
        if len(found) == 1:
            raise DeviceError(f"{self._link.name}: {wanted} is not a {self._hand} hand's")
        if found:
            raise DeviceError(f"{self._link.name} has {len(found)} {wanted}s: {there}; name one by its number")
        raise DeviceError(f"{self._link.name}: no {wanted} within {timeout:g} s; gloves there: {there}")

    def _candidates(self, seen: dict[int, GloveMessage]) -> list[GloveMessage]:
        """Return the glove that is named, or those of our hand; without any, those of unknown hand."""
        if self._wanted_id is not None:
            return [seen[self._wanted_id]] if self._wanted_id in seen else []
        ours = [message for message in seen.values() if message.right is (self._hand == "right")]
        return ours or [message for message in seen.values() if message.right is None]

    def _is_ours(self, glove: GloveMessage) -> bool:
        return glove.right in (None, self._hand == "right")

    def _begin_stream(self) -> None:
        """Forget the stream of an earlier connection."""
        self._connection, self._bytes = self._link.connection, bytearray()
        self._lost, self._malformed_run = None, 0
        self._stiffness = list(UNKNOWN_STIFFNESS)

    def _renew(self) -> None:
        """Begin the stream anew if the link has a new connection."""
        if self._link.connection != self._connection:
            self._begin_stream()
            self.counters.resyncs += 1

    def _take_bytes(self) -> None:
        """Cut what has arrived into `_waiting`."""
        self._bytes += self._link.receive() or b""
        now = time.monotonic_ns()
        while (frame := next_message(self._bytes)) is not None:
            self._waiting.append((frame, now))

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
                self._link.send(encode_impedance(self._device_id, FREE, FREE, kept=True), urgent=True)

    def _store(self, message: bytes, now: int, row: np.void) -> int:
        self.counters.frames += 1
        try:
            gloves = decode_frame(message)
        except WireError as error:
            self.counters.malformed += 1
            self._malformed_run += 1
            if self._malformed_run >= MOST_MALFORMED:
                self._give_up(f"{self._malformed_run} frames in a row cannot be read: {error}")
            return 0
        self._malformed_run = 0
        glove = next((glove for glove in gloves if glove.device_id == self._device_id), None)
        if glove is not None:
            was_other, self._other_hand = self._other_hand, not self._is_ours(glove)
            if self._other_hand and not was_other:
                self._free_fingers()
                side = "left" if self._hand == "right" else "right"
                reason = f"glove {self._device_id} says that it is a {side} hand's now, and not a {self._hand} one's"
                self._lost = DeviceError(f"{self._link.name}: {reason}")
        if glove is None or self._other_hand or glove.channels is None:
            self.counters.other += 1
            return 0
        if glove.battery is not None:
            self._battery = glove.battery if 0 <= glove.battery <= 100 else UNKNOWN
        readings = np.array(glove.channels)
        # Python's loop is faster than numpy's on eleven numbers with cold caches.
        found = self._calibration.hand_angles(readings) if all(map(math.isfinite, glove.channels)) else None
        self._angles = found or self._angles
        self._write_sample(row, now, found is not None, readings, self._angles, battery=self._battery)
        return 1
