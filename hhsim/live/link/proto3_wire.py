"""The part of the proto3 wire format that gloves speak: int32, bool, float and messages.

It is read here, and not by protobuf's library, because it is read in the loop: a sample's floats are unpacked at once,
without an object for each field, and nothing is loaded for it in the watchdog. Tests hold it against the library.

What arrives is taken as protobuf's own parsers take it: fields in any order, the last value of a field wins, the parts
of a message that comes in pieces are merged, and fields that are not known are skipped (protobuf.dev, "Encoding").
"""

import struct
from collections.abc import Iterator, Mapping
from enum import Enum, auto
from typing import Any, NamedTuple

from hhsim.errors import HhsimError

Message = dict[str, Any]
"""Every field of a message by name: numbers, None or a `Message`, or a list of them where the field is repeated."""

DEEPEST = 100
"""Groups within groups, as protobuf's own parsers limit them."""
TAG_BYTES, SIZE_BYTES, VARINT_BYTES = 5, 5, 10
VARINT, FIXED64, BYTES, GROUP, GROUP_END, FIXED32 = range(6)
SIGN = 1 << 31
FLOAT = struct.Struct("<f")


class WireError(HhsimError):
    """Bytes that are no message."""


class Kind(Enum):
    """Of a field's values."""

    INT32 = auto()
    BOOL = auto()
    FLOAT = auto()
    MESSAGE = auto()

    @property
    def wire(self) -> int:
        """The wire type."""
        return {Kind.FLOAT: FIXED32, Kind.MESSAGE: BYTES}.get(self, VARINT)


class Field(NamedTuple):
    """A field of a message.

    Attributes:
        number: On the wire.
        name: In a `Message`.
        kind: Of its values.
        schema: Of a message.
        repeated: Whether it holds a list; messages only.
    """

    number: int
    name: str
    kind: Kind
    schema: "Schema | None" = None
    repeated: bool = False

    @property
    def tag(self) -> int:
        """What stands before each value."""
        return self.number << 3 | self.kind.wire


class Schema:
    """What a message is made of.

    Args:
        fields: By ascending number.
    """

    def __init__(self, *fields: Field) -> None:
        """Prepare the tables that reading and writing use."""
        self.fields = fields
        self.by_tag = {field.tag: field for field in fields}
        self._plain: Message = {
            field.name: {Kind.FLOAT: 0.0, Kind.INT32: 0, Kind.BOOL: False}.get(field.kind) for field in fields
        }
        self._lists = [field.name for field in fields if field.repeated]
        self.whole_tags = b""
        if all(field.kind is Kind.FLOAT and field.tag < 128 for field in fields):
            # Floats alone, all of them, in order: what a glove sends nearly always, unpacked at once.
            self.whole_tags = bytes(field.tag for field in fields)
            self.whole = struct.Struct("<" + "xf" * len(fields))
        self._names = [field.name for field in fields]

    def new(self) -> Message:
        """A message with every field at its default."""
        message = self._plain.copy()
        for name in self._lists:
            message[name] = []
        return message

    def unpack_whole(self, data: bytes, at: int) -> Iterator[tuple[str, float]]:
        """Names and values of a message that `whole_tags` fits, from its first byte on."""
        return zip(self._names, self.whole.unpack_from(data, at))


def decode(schema: Schema, data: bytes) -> Message:
    """The message of some bytes; floats may be NaN or infinite.

    Raises:
        WireError: No such message.
    """
    message = schema.new()
    _read(schema, data, 0, len(data), message)
    return message


def encode(schema: Schema, message: Mapping[str, Any]) -> bytes:
    """The bytes of a message: fields in their order, numbers that are at their default left out.

    Args:
        message: Fields that it does not have are at their default.

    Raises:
        WireError: A number that its field cannot hold.
    """
    out = bytearray()
    for field in schema.fields:
        value = message.get(field.name)
        if value is None:
            continue
        if field.schema is not None:
            for part in value if field.repeated else (value,):
                body = encode(field.schema, part)
                out += _varint(field.tag) + _varint(len(body)) + body
        elif field.kind is Kind.FLOAT:
            try:
                packed = FLOAT.pack(value)
            except (OverflowError, struct.error):
                raise WireError(f"{field.name} = {value!r}: expected a 32-bit float") from None
            if packed != b"\0\0\0\0":
                out += _varint(field.tag) + packed
        elif value:
            number = int(value)
            if not -SIGN <= number < SIGN:
                raise WireError(f"{field.name} = {value!r}: expected a 32-bit integer")
            # Negative numbers are written as 64-bit ones.
            out += _varint(field.tag) + _varint(number & (1 << 64) - 1)
    return bytes(out)


def _varint(number: int) -> bytes:
    out = bytearray()
    while number > 127:
        out.append(number & 127 | 128)
        number >>= 7
    out.append(number)
    return bytes(out)


def _read(schema: Schema, data: bytes, at: int, end: int, message: Message) -> None:
    if schema.whole_tags and end - at == schema.whole.size and data[at:end:5] == schema.whole_tags:
        message.update(schema.unpack_whole(data, at))
        return
    while at < end:
        tag, at = _read_varint(data, at, end, TAG_BYTES)
        field = schema.by_tag.get(tag)
        if field is None:
            at = _skip(data, at, end, tag, 0)
        elif field.schema is not None:
            size, at = _read_varint(data, at, end, SIZE_BYTES)
            if size > end - at:
                raise WireError(f"{field.name} is cut short: {end - at} of {size} bytes")
            part = message[field.name]
            if field.repeated:
                part.append(field.schema.new())
                part = part[-1]
            elif part is None:
                part = message[field.name] = field.schema.new()
            _read(field.schema, data, at, at + size, part)
            at += size
        elif field.kind is Kind.FLOAT:
            if end - at < 4:
                raise WireError(f"{field.name} is cut short: {end - at} of 4 bytes")
            (message[field.name],) = FLOAT.unpack_from(data, at)
            at += 4
        else:
            number, at = _read_varint(data, at, end, VARINT_BYTES)
            if field.kind is Kind.BOOL:
                message[field.name] = number != 0
            else:
                message[field.name] = ((number & (2 * SIGN - 1)) ^ SIGN) - SIGN


def _read_varint(data: bytes, at: int, end: int, most: int) -> tuple[int, int]:
    number = shift = 0
    for place in range(at, min(end, at + most)):
        byte = data[place]
        number |= (byte & 127) << shift
        if byte < 128:
            number &= (1 << 64) - 1
            if most < VARINT_BYTES and number >= 2 * SIGN:
                raise WireError(f"a tag or a size of {number}: expected 32 bits")
            return number, place + 1
        shift += 7
    raise WireError("a number is cut short" if end - at < most else f"a number of more than {most} bytes")


def _skip(data: bytes, at: int, end: int, tag: int, depth: int) -> int:
    """Where the value of an unknown field ends."""
    if tag >> 3 == 0:
        raise WireError("a field of number 0")
    wire = tag & 7
    if wire == VARINT:
        return _read_varint(data, at, end, VARINT_BYTES)[1]
    if wire == GROUP:
        if depth >= DEEPEST:
            raise WireError(f"more than {DEEPEST} groups within each other")
        while True:
            inner, at = _read_varint(data, at, end, TAG_BYTES)
            if inner == tag + 1:
                return at
            at = _skip(data, at, end, inner, depth + 1)
    if wire == FIXED64:
        size = 8
    elif wire == FIXED32:
        size = 4
    elif wire == BYTES:
        size, at = _read_varint(data, at, end, SIZE_BYTES)
    else:
        raise WireError(f"wire type {wire} where a field begins")
    if size > end - at:
        raise WireError(f"an unknown field is cut short: {end - at} of {size} bytes")
    return at + size
