"""The Dexmo wire format: the bytes of its messages, broken ones, and the cutting of a stream."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hhsim.live.link.dexmo_codec import (
    CHANNELS,
    FramingError,
    GloveMessage,
    MessageStream,
    WireError,
    decode_frame,
    encode_impedance,
    framed,
)
from tools.dexmo_server import decode_impedances, encode_frame

FIVE = [0.5, 0.25, 0.75, 1.0, 0.125]


def floats(first: int, *values: float) -> bytes:
    """Fields of floats by ascending number, as proto3 writes them."""
    return b"".join(bytes([first + k << 3 | 5]) + struct.pack("<f", value) for k, value in enumerate(values))


def within(tag: int, body: bytes) -> bytes:
    return bytes([tag, len(body)]) + body


def test_the_bytes_are_those_of_the_published_format() -> None:
    channels = tuple((k + 1) / 16 for k in range(len(CHANNELS)))
    glove = b"\x08\x05" + within(0x12, floats(3, *channels)) + within(0x1A, b"\x10\x01\x18\x57")
    assert encode_frame([GloveMessage(5, channels, True, 87)]) == within(0x12, glove)
    fingers = b"".join(within(k + 1 << 3 | 2, floats(1, hard, -hard)) for k, hard in enumerate(FIVE))
    command = b"\x08\x07" + within(0x12, fingers + b"\x30\x01")
    assert encode_impedance(7, FIVE, [-hard for hard in FIVE], kept=True) == command


def test_a_finger_at_zero_is_named_all_the_same() -> None:
    command = b"\x08\x07" + within(0x12, b"".join(bytes([k + 1 << 3 | 2, 0]) for k in range(5)))
    assert encode_impedance(7, [0.0] * 5, [0.0] * 5, kept=False) == command


def test_a_frame_of_two_gloves_comes_back() -> None:
    channels = tuple(struct.unpack("<11f", struct.pack("<11f", *(k / 12 for k in range(11)))))
    gloves = [
        GloveMessage(337785601, channels, True, 87),
        GloveMessage(5, channels[::-1], False, 0),
        GloveMessage(-7),
        GloveMessage(6, None, True, 3),
    ]
    assert decode_frame(encode_frame(gloves)) == gloves


@given(st.binary(max_size=120))
def test_any_bytes_are_refused_or_read(data: bytes) -> None:
    for decode in (decode_frame, decode_impedances):
        try:
            assert isinstance(decode(data), list)
        except WireError as error:
            assert str(error).startswith(f"{len(data)} bytes that are no ")


def messages_of(stream: MessageStream) -> list[bytes]:
    found = []
    while (payload := stream.next()) is not None:
        found.append(payload)
    return found


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
