"""Messages between a Dexmo server and its clients.

Both ways: the length of a message as a little-endian int32, then the message in proto3. The server sends `Frame`, the
client `Command`. Field numbers and meanings are those of the vendor's example client for its Linux server 1.1.6, names
are ours; unused fields of a command (rumble, other) are skipped. A frame has neither a stamp nor a number nor a force.
"""

import struct
from collections.abc import Sequence
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple

from hhsim.errors import HhsimError

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

_channels = attrgetter(*CHANNELS)


class FramingError(HhsimError):
    """A length that no message has: the framing is lost until a new connection."""


class WireError(HhsimError):
    """Bytes that are no message."""


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


def decode_frame(payload: bytes) -> list[GloveMessage]:
    """Return the gloves of a frame; raises WireError if it is none."""
    found = []
    for message in parse_message("Frame", payload).messages:
        channels = _channels(message.hand) if message.HasField("hand") else None
        told = (message.device.is_right, message.device.battery_percent) if message.HasField("device") else ()
        found.append(GloveMessage(message.id, channels, *told))
    return found


def encode_impedance(device_id: int, stiffness: Sequence[float], set_point: Sequence[float], *, kept: bool) -> bytes:
    """Encode a command to the fingers of one glove, thumb to little finger, without its length.

    `stiffness` is 0 (free) to 1, `set_point` the bend at which a force begins, 0 to 1, positive against closing,
    negative against opening. The server may not drop a `kept` command for a newer one (has_index).
    """
    fingers = zip(FINGER_FIELDS, stiffness, set_point, strict=True)
    commands = {name: {"stiffness": hard, "set_point": place} for name, hard, place in fingers}
    command = message_classes()["Command"](id=device_id, impedance=[{"has_index": kept, **commands}])
    data: bytes = command.SerializeToString()
    return data


def parse_message(name: str, payload: bytes) -> Any:
    """Parse one of `MESSAGES`; raises WireError if it is none."""
    from google.protobuf.message import DecodeError

    try:
        return message_classes()[name].FromString(payload)
    except DecodeError:
        raise WireError(f"{len(payload)} bytes that are no {name}") from None


class MessageStream:
    """Cuts a stream of bytes into messages, however the bytes arrive."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._at = 0

    def __len__(self) -> int:
        return len(self._bytes) - self._at

    def feed(self, data: bytes) -> None:
        """Append what has arrived."""
        del self._bytes[: self._at]
        self._at = 0
        self._bytes += data

    def next(self) -> bytes | None:
        """Return the next message without its length, None until it is whole; raises FramingError for a bad length."""
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
