"""The Dexmo wire format against google.protobuf, on good and on broken bytes, and the cutting of a stream."""

import random
import struct
from typing import Any

import pytest
from dexmo_protobuf import SCALARS, TABLES, as_plain, message_classes
from google.protobuf.message import DecodeError
from hypothesis import given
from hypothesis import strategies as st

from hhsim.live.link import dexmo_codec
from hhsim.live.link.dexmo_codec import (
    CHANNELS,
    COMMAND,
    FRAME,
    FramingError,
    GloveMessage,
    Impedance,
    MessageStream,
    decode_frame,
    decode_impedances,
    encode_frame,
    encode_impedance,
    framed,
)
from hhsim.live.link.proto3_wire import Schema, WireError, decode, encode

CLASSES = message_classes()
ROOTS: tuple[tuple[str, Schema], ...] = (("Frame", FRAME), ("Command", COMMAND))
FLOATS = (0.0, -0.0, 1.0, -1.0, 0.5, float("inf"), float("-inf"), float("nan"), 1e-45, 3.4028234663852886e38)
INTEGERS = (0, 1, -1, 127, 128, 337785601, 2**31 - 1, -(2**31))
UNKNOWN = b"\x7a\x03abc"
"""A field that no message has."""
FIVE = [0.5, 0.25, 0.75, 1.0, 0.125]


def fill(message: Any, kind: str, source: random.Random) -> None:
    """Random fields; some of the messages within are there, as are up to three of each list."""
    for _, field, type_ in TABLES[kind]:
        if type_.startswith("*"):
            for _ in range(source.choice((0, 0, 1, 1, 3))):
                fill(getattr(message, field).add(), type_[1:], source)
        elif type_ not in SCALARS:
            if source.random() < 0.4:
                part = getattr(message, field)
                part.SetInParent()
                fill(part, type_, source)
        elif source.random() < 0.8:
            setattr(message, field, number(type_, source))


def number(type_: str, source: random.Random) -> Any:
    if type_ == "bool":
        return source.random() < 0.5
    if type_ == "int32":
        return source.choice(INTEGERS) if source.random() < 0.3 else source.randrange(-(2**31), 2**31)
    return source.choice(FLOATS) if source.random() < 0.2 else source.uniform(-1.5, 1.5)


MESSAGES = pytest.mark.parametrize("count", [5_000, pytest.param(100_000, marks=pytest.mark.soak)])


@MESSAGES
def test_random_messages_are_as_google_protobuf_has_them(count: int) -> None:
    source = random.Random(1)
    for k in range(count):
        name, schema = ROOTS[k % 2]
        theirs = CLASSES[name]()
        fill(theirs, name, source)
        data = theirs.SerializeToString()
        ours = decode(schema, data)
        # By their text: NaN is not equal to itself, and −0 is not 0.
        assert repr(ours) == repr(as_plain(theirs, name))
        assert encode(schema, ours) == data


def broken(source: random.Random, good: bytes) -> bytes:
    """A message that something happened to."""
    data = bytearray(good)
    kind = source.randrange(5)
    if kind == 0:
        return bytes(data[: source.randrange(len(data))])
    if kind == 1:
        for _ in range(source.randrange(1, 4)):
            data[source.randrange(len(data))] = source.randrange(256)
    elif kind == 2:
        return source.randbytes(source.randrange(80))
    elif kind == 3:
        at = source.randrange(len(data))
        data[at:at] = source.randbytes(source.randrange(1, 12))
    else:
        first, last = sorted(source.sample(range(len(data) + 1), 2))
        del data[first:last]
    return bytes(data)


@MESSAGES
def test_broken_messages_are_refused_or_read_as_google_protobuf_does(count: int) -> None:
    source = random.Random(2)
    good = []
    for k, (name, schema) in enumerate(ROOTS * 20):
        theirs = CLASSES[name]()
        fill(theirs, name, source)
        good.append((name, schema, theirs.SerializeToString() + UNKNOWN * (k % 4 == 0)))
    good = [row for row in good if row[2]]
    refused = 0
    for k in range(count):
        name, schema, whole = good[k % len(good)]
        data = broken(source, whole)
        try:
            theirs = repr(as_plain(CLASSES[name].FromString(data), name))
        except DecodeError:
            theirs = "refused"
        try:
            ours = repr(decode(schema, data))
        except WireError:
            ours = "refused"
        assert ours == theirs, data.hex()
        refused += ours == "refused"
    assert 0.3 * count < refused < 0.95 * count, "both ways are taken"


@given(st.binary(max_size=120), st.sampled_from(ROOTS))
def test_any_bytes_are_refused_or_read_as_google_protobuf_does(data: bytes, root: tuple[str, Schema]) -> None:
    name, schema = root
    try:
        theirs = CLASSES[name].FromString(data)
    except DecodeError:
        with pytest.raises(WireError):
            decode(schema, data)
    else:
        assert repr(decode(schema, data)) == repr(as_plain(theirs, name))


@pytest.mark.parametrize(
    "data",
    [
        b"\x0b\x08\x01\x0c",  # a group that is closed
        b"\x0b\x0b\x0c\x0c",  # two, one within the other; the inner one's number is ours
        b"\x0b\x14",  # closed by another
        b"\x0b",  # never closed
        b"\x0c",  # closed and never opened
        b"\x0b" * 99 + b"\x0c" * 99,
        b"\x0b" * 3000 + b"\x0c" * 3000,
        b"\x00\x01",  # number 0
        b"\x0e\x01",  # no such wire type
        b"\x08" + b"\xff" * 9 + b"\x01",  # −1 in ten bytes
        b"\x08" + b"\xff" * 10 + b"\x01",  # eleven
        b"\x08\x80\x80\x80\x80\x10",  # more than 32 bits: the lower ones
        b"\x88\x80\x80\x80\x00\x05",  # a tag with zeros before it
        b"\x88\x80\x80\x80\x80\x00\x05",
        b"\x12\xff\xff\xff\xff\x07",  # 2 GB within
        b"\x12\xff\xff\xff\xff\x0f",
        b"\x0d\x01\x02\x03\x04",  # a known number as another type
        b"\x12\x02\x08\x05\x12\x02\x08\x06",  # two of a list
        b"\x12\x09\x12\x05\x1d\0\0\x80\x3f\x12\x00",  # a message in two pieces
    ],
)
def test_corners_of_the_format_are_as_in_google_protobuf(data: bytes) -> None:
    for name, schema in ROOTS:
        try:
            theirs = repr(as_plain(CLASSES[name].FromString(data), name))
        except DecodeError:
            theirs = "refused"
        try:
            ours = repr(decode(schema, data))
        except WireError:
            ours = "refused"
        assert ours == theirs


def test_a_frame_of_two_gloves_comes_back() -> None:
    channels = tuple(struct.unpack("<11f", struct.pack("<11f", *(k / 12 for k in range(11)))))
    gloves = [
        GloveMessage(337785601, channels, True, 87),
        GloveMessage(5, channels[::-1], False, 0),
        GloveMessage(-7),
        GloveMessage(6, None, True, 3),
    ]
    assert decode_frame(encode_frame(gloves)) == gloves
    theirs = CLASSES["Frame"].FromString(encode_frame(gloves))
    assert [message.id for message in theirs.messages] == [337785601, 5, -7, 6]
    assert theirs.messages[0].hand.pinky_bend == channels[-1] and theirs.messages[1].device.is_right is False


@pytest.mark.parametrize("stiffness", [[0.0] * 5, FIVE, [0.0, 0.5, 0.0, 1e-50, 1.0]])
@pytest.mark.parametrize("set_point", [[0.0] * 5, FIVE[::-1], [-0.5, 0.0, -0.0, 1.0, 1e-50]])
@pytest.mark.parametrize("kept", [False, True])
@pytest.mark.parametrize("device_id", [0, 337785601, -5])
def test_a_command_is_byte_for_byte_google_protobufs(
    stiffness: list[float], set_point: list[float], kept: bool, device_id: int
) -> None:
    theirs = CLASSES["Command"](id=device_id)
    impedance = theirs.impedance.add(has_index=kept)
    for finger, stiff, point in zip(dexmo_codec.FINGER_FIELDS, stiffness, set_point):
        part = getattr(impedance, finger)
        part.SetInParent()
        part.stiffness, part.set_point = stiff, point
    data = encode_impedance(device_id, stiffness, set_point, kept=kept)
    assert data == theirs.SerializeToString()
    (back,) = decode_impedances(data)
    as_float32 = [tuple(struct.unpack("<5f", struct.pack("<5f", *values))) for values in (stiffness, set_point)]
    assert back == Impedance(device_id, as_float32[0], as_float32[1], kept)


def test_a_finger_that_a_command_does_not_name_is_told_nothing() -> None:
    (back,) = decode_impedances(encode(COMMAND, {"id": 1, "impedance": [{"ring": {"stiffness": 1.0}}]}))
    assert back.stiffness == (0.0, 0.0, 0.0, 1.0, 0.0) and not back.kept


@pytest.mark.parametrize("value", [1e300, "hard", None])
def test_numbers_that_a_command_cannot_hold_are_refused(value: Any) -> None:
    with pytest.raises(WireError, match="expected 32-bit float"):
        encode_impedance(1, [value] + [0.0] * 4, [0.0] * 5, kept=True)


def test_numbers_that_a_field_cannot_hold_are_refused() -> None:
    with pytest.raises(WireError, match="expected a 32-bit integer"):
        encode(COMMAND, {"id": 2**31})
    with pytest.raises(WireError, match="expected a 32-bit float"):
        encode_frame([GloveMessage(1, (1e300,) * len(CHANNELS))])


def messages_of(stream: MessageStream) -> list[bytes]:
    found = []
    while (payload := stream.next()) is not None:
        found.append(payload)
    return found


def test_one_byte_at_a_time_gives_the_same_messages() -> None:
    source = random.Random(3)
    sent = [source.randbytes(source.choice((0, 1, 3, 4, 70, 8192))) for _ in range(60)]
    stream, found = MessageStream(), []
    for byte in b"".join(map(framed, sent)):
        stream.feed(bytes((byte,)))
        found += messages_of(stream)
    assert found == sent and len(stream) == 0


@given(st.lists(st.binary(max_size=40), max_size=12), st.lists(st.integers(1, 60), min_size=1), st.integers(0, 60))
def test_the_cuts_of_a_stream_do_not_matter(sent: list[bytes], cuts: list[int], missing: int) -> None:
    whole = b"".join(map(framed, sent))
    given = whole[: max(0, len(whole) - missing)]
    stream, found, at, k = MessageStream(), [], 0, 0
    while at < len(given):
        stream.feed(given[at : at + cuts[k % len(cuts)]])
        at, k = at + cuts[k % len(cuts)], k + 1
        found += messages_of(stream)
    arrived, left = [], len(given)
    for payload in sent:
        if left < 4 + len(payload):
            break
        arrived.append(payload)
        left -= 4 + len(payload)
    assert found == arrived and len(stream) == left


@pytest.mark.parametrize("length", [-1, -(2**31), 2**31 - 1, 8193])
def test_a_length_that_no_message_has_is_refused_at_once_and_again(length: int) -> None:
    stream = MessageStream()
    stream.feed(framed(b"good") + struct.pack("<i", length) + b"rest")
    assert stream.next() == b"good"
    for _ in range(2):
        with pytest.raises(FramingError, match=f"a message of {length} bytes: expected 0 to 8192"):
            stream.next()
    assert len(stream) == 8, "nothing of it was taken, and nothing waited for"


def test_a_stream_of_broken_frames_ends_in_a_typed_error_or_in_messages() -> None:
    source = random.Random(4)
    good = framed(encode_frame([GloveMessage(337785601, (0.5,) * 11, True, 87)]))
    read = lost = refused = 0
    for _ in range(2000):
        data = bytearray(good * 5)
        for _ in range(source.randrange(1, 4)):
            data[source.randrange(len(data))] = source.randrange(256)
        stream = MessageStream()
        stream.feed(bytes(data[: source.randrange(len(data))]))
        try:
            for payload in messages_of(stream):
                try:
                    decode_frame(payload)
                    read += 1
                except WireError:
                    refused += 1
        except FramingError:
            lost += 1
    assert read > 1000 and lost > 50 and refused > 50, "all of it happens"
