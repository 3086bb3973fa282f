"""What a Dexmo server and its clients write to each other.

Both ways: the length of a message as a little-endian int32, then the message in proto3. The server sends `FRAME`, the
client `COMMAND`. Field numbers and meanings as in the vendor's example client for its Linux server 1.1.6; the names
here are ours; what of a command is never used (rumble, other) is skipped as any unknown field is. A frame carries
neither a stamp nor a number nor a force that was felt.
"""

import struct
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from hhsim.errors import HhsimError
from hhsim.live.link.proto3_wire import FLOAT, Field, Kind, Message, Schema, WireError, decode, encode

CHANNELS = (
    *("thumb_rotate", "thumb_split", "thumb_bend", "index_split", "index_bend", "middle_split", "middle_bend"),
    *("ring_split", "ring_bend", "pinky_split", "pinky_bend"),
)
"""Channels of a hand in the order of their field numbers, 3 to 13; the vendor's pinky is our little finger."""
FINGER_FIELDS = ("thumb", "index", "middle", "ring", "pinky")

HAND = Schema(*(Field(number, name, Kind.FLOAT) for number, name in enumerate(CHANNELS, start=3)))
DEVICE = Schema(Field(2, "is_right", Kind.BOOL), Field(3, "battery_percent", Kind.INT32))
FRAME_MESSAGE = Schema(
    Field(1, "id", Kind.INT32),
    Field(2, "hand", Kind.MESSAGE, HAND),
    Field(3, "device", Kind.MESSAGE, DEVICE),
)
FRAME = Schema(
    Field(1, "frame_len", Kind.INT32),
    Field(2, "messages", Kind.MESSAGE, FRAME_MESSAGE, repeated=True),
)

IMPEDANCE_DATA = Schema(Field(1, "stiffness", Kind.FLOAT), Field(2, "set_point", Kind.FLOAT))
IMPEDANCE = Schema(
    *(Field(number, name, Kind.MESSAGE, IMPEDANCE_DATA) for number, name in enumerate(FINGER_FIELDS, start=1)),
    Field(6, "has_index", Kind.BOOL),
)
COMMAND = Schema(
    Field(1, "id", Kind.INT32),
    Field(2, "impedance", Kind.MESSAGE, IMPEDANCE, repeated=True),
)

FINGER_TAGS = tuple(field.tag for field in IMPEDANCE.fields[:5])
HAS_INDEX = bytes((IMPEDANCE.fields[5].tag, 1))
STIFFNESS_TAG, SET_POINT_TAG = (bytes((field.tag,)) for field in IMPEDANCE_DATA.fields)
IMPEDANCE_TAG = bytes((COMMAND.fields[1].tag,))
ZERO = FLOAT.pack(0.0)

MOST_BYTES = 8192
"""Of a message: a glove takes about 80. A longer one means that the framing is lost."""
LENGTH = struct.Struct("<i")


class FramingError(HhsimError):
    """A length that no message has: where the next message begins is lost, and only a new connection knows."""


class GloveMessage(NamedTuple):
    """What one glove says in a frame.

    Attributes:
        channels: In the order of `CHANNELS`, None without hand data. They may be NaN or infinite.
        right: Whether it is a right hand's, None where the frame does not say it.
        battery: Charge [%], None where the frame does not say it.
    """

    device_id: int
    channels: tuple[float, ...] | None = None
    right: bool | None = None
    battery: int | None = None


class Impedance(NamedTuple):
    """What the fingers of one glove are told.

    Attributes:
        stiffness: Of each finger from thumb to little finger, 0 (free) to 1.
        set_point: Bend at which a force begins, 0 to 1; positive against closing, negative against opening.
        kept: The server may not drop the command for a newer one (has_index).
    """

    device_id: int
    stiffness: tuple[float, ...]
    set_point: tuple[float, ...]
    kept: bool


def framed(payload: bytes) -> bytes:
    """A message with its length before it."""
    return LENGTH.pack(len(payload)) + payload


def decode_frame(payload: bytes) -> list[GloveMessage]:
    """The gloves of a frame.

    Raises:
        WireError: No frame.
    """
    found = []
    for message in decode(FRAME, payload)["messages"]:
        hand, device = message["hand"], message["device"]
        found.append(
            GloveMessage(
                message["id"],
                None if hand is None else tuple(hand.values()),
                None if device is None else device["is_right"],
                None if device is None else device["battery_percent"],
            )
        )
    return found


def encode_frame(gloves: Iterable[GloveMessage]) -> bytes:
    """A frame as the server sends it, without its length.

    Raises:
        WireError: A number that its field cannot hold.
    """
    messages = []
    for glove in gloves:
        message: Message = {"id": glove.device_id}
        if glove.channels is not None:
            message["hand"] = dict(zip(CHANNELS, glove.channels, strict=True))
        if glove.right is not None:
            message["device"] = {"is_right": glove.right, "battery_percent": glove.battery or 0}
        messages.append(message)
    return encode(FRAME, {"messages": messages})


def decode_impedances(payload: bytes) -> list[Impedance]:
    """What a command tells the fingers; a finger that it does not name is told 0.

    Raises:
        WireError: No command.
    """
    command = decode(COMMAND, payload)
    free = IMPEDANCE_DATA.new()
    found = []
    for impedance in command["impedance"]:
        fingers = [impedance[name] or free for name in FINGER_FIELDS]
        found.append(
            Impedance(
                command["id"],
                tuple(finger["stiffness"] for finger in fingers),
                tuple(finger["set_point"] for finger in fingers),
                impedance["has_index"],
            )
        )
    return found


def encode_impedance(device_id: int, stiffness: Sequence[float], set_point: Sequence[float], *, kept: bool) -> bytes:
    """A command as a client sends it, without its length; every finger is named. Arguments as in `Impedance`.

    Raises:
        WireError: A number that its field cannot hold.
    """
    # Written out rather than with `encode`: this is the one message that is made in every tick.
    body = bytearray()
    try:
        for tag, stiff, point in zip(FINGER_TAGS, stiffness, set_point, strict=True):
            hard, place = FLOAT.pack(stiff), FLOAT.pack(point)
            finger = (b"" if hard == ZERO else STIFFNESS_TAG + hard) + (b"" if place == ZERO else SET_POINT_TAG + place)
            body.append(tag)
            body.append(len(finger))
            body += finger
    except (OverflowError, struct.error):
        raise WireError(f"stiffness {stiffness!r} at {set_point!r}: expected 32-bit floats") from None
    if kept:
        body += HAS_INDEX
    return encode(COMMAND, {"id": device_id}) + IMPEDANCE_TAG + bytes((len(body),)) + body


class MessageStream:
    """Cuts a stream of bytes into messages, however the bytes arrive; one beyond `MOST_BYTES` is not waited for."""

    def __init__(self) -> None:
        """Nothing has arrived."""
        self._bytes = bytearray()
        self._at = 0

    def __len__(self) -> int:
        """Bytes that have arrived and were not handed on."""
        return len(self._bytes) - self._at

    def feed(self, data: bytes) -> None:
        """Take what has arrived."""
        del self._bytes[: self._at]
        self._at = 0
        self._bytes += data

    def next(self) -> bytes | None:
        """The next message, without its length; None until all of it is there.

        Raises:
            FramingError: A negative length, or one that no message has.
        """
        start = self._at + LENGTH.size
        if start > len(self._bytes):
            return None
        (length,) = LENGTH.unpack_from(self._bytes, self._at)
        if not 0 <= length <= MOST_BYTES:
            raise FramingError(f"a message of {length} bytes: expected 0 to {MOST_BYTES}")
        if start + length > len(self._bytes):
            return None
        self._at = start + length
        return bytes(self._bytes[start : self._at])
