"""The bytes of a DOGlove: frames of its board as its firmware makes them, found in a line that is torn."""

import numpy as np
import pytest
from doglove_peer import datagram, reading_of, uart_frame
from hypothesis import given
from hypothesis import strategies as st

from hhsim.live.link.doglove_codec import (
    FRAME_BYTES,
    FrameError,
    FrameStream,
    decode_encoders,
    decode_frame,
    decode_servos,
)

READINGS = [0x100 * i - 0x400 for i in range(16)]


def test_a_frame_is_that_of_the_table_byte_by_byte() -> None:
    # 3.3 V, the readings -1024 to 2816 in steps of 256, 0x1234 ms.
    head = bytes.fromhex("aa550000a05a320000fcffff00fdffff00feffff00ffffff00000000")
    words = b"".join(value.to_bytes(4, "little") for value in range(0x100, 0xC00, 0x100))
    total = (3_300_000 + sum(READINGS)) & 0xFFFF
    frame = head + words + (0x1234).to_bytes(2, "little") + total.to_bytes(2, "little")
    assert len(frame) == FRAME_BYTES
    assert frame == uart_frame(3_300_000, READINGS, 0x1234)
    found = decode_frame(frame)
    assert found.milliseconds == 0x1234
    np.testing.assert_allclose(found.degrees, [value * 5.0 / 0x7FFFFF / 3.3 * 360.0 for value in READINGS])


@given(st.integers(2_700_000, 5_000_000), st.lists(st.floats(-20.0, 360.0), min_size=16, max_size=16))
def test_angles_come_back_to_a_count(reference: int, degrees: list[float]) -> None:
    found = decode_frame(uart_frame(reference, [reading_of(angle, reference) for angle in degrees], 7))
    count = 5.0 / 0x7FFFFF / (1e-6 * reference) * 360.0
    assert np.abs(found.degrees - degrees).max() <= 0.5 * count + 1e-9


def test_datagrams_are_the_angles_themselves() -> None:
    assert decode_encoders(datagram(range(16))).degrees.tolist() == list(range(16))
    assert decode_servos(bytes.fromhex("0000803f0000004000004040000080400000a040")).tolist() == [1, 2, 3, 4, 5]


@pytest.mark.parametrize("place", [4, 20, 72, 74])
def test_a_bit_that_flips_is_found(place: int) -> None:
    frame = bytearray(uart_frame(3_300_000, READINGS, 1))
    frame[place if place != 72 else 75] ^= 4
    with pytest.raises(FrameError, match="sum"):
        decode_frame(bytes(frame))


@pytest.mark.parametrize(
    ("read", "data"),
    [
        (decode_frame, b""),
        (decode_frame, bytes(76)),
        (decode_frame, uart_frame(0, [0] * 16, 0)),
        (decode_encoders, bytes(63)),
        (decode_encoders, datagram(range(5))),
        (decode_servos, datagram(range(16))),
    ],
)
def test_other_bytes_are_refused(read: object, data: bytes) -> None:
    assert callable(read)
    with pytest.raises(FrameError):
        read(data)


@given(st.binary(max_size=90), st.lists(st.integers(1, 200), max_size=12), st.integers(0, 5))
def test_frames_are_found_in_whatever_stands_before_them(junk: bytes, cuts: list[int], torn: int) -> None:
    frames = [uart_frame(3_300_000, [number] * 16, number) for number in range(1, 8)]
    frames[torn] = frames[torn][:-3] + b"\x00\x00\x01"
    line = junk + b"".join(frames) + uart_frame(3_300_000, [0] * 16, 99)
    stream, found = FrameStream(), []
    for cut in [*cuts, len(line)]:
        part, line = line[:cut], line[cut:]
        found += [frame.milliseconds for frame in stream.feed(part)]
    assert [number for number in found if 0 < number < 8] == [n for n in range(1, 8) if n != torn + 1]
    assert found[-1] == 99
    assert stream.malformed >= 1


def test_a_header_among_the_readings_is_no_header() -> None:
    readings = [0x55AA] * 16
    frame = uart_frame(3_300_000, readings, 5)
    stream = FrameStream()
    found = stream.feed(frame[10:] + frame + frame)
    assert [each.milliseconds for each in found] == [5, 5]
