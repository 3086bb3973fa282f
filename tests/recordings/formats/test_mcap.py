"""MCAP of Isaac Teleop: our own hand's motion in records that are laid out by hand here."""

import struct
from typing import Any

import numpy as np
import pytest
from joint_samples import Side, joint_sample, mcap_bytes
from recording_samples import read_as

from hhsim.errors import TrajectoryError
from hhsim.recordings.formats import mcap
from hhsim.recordings.registry import Content, ReadOptions, read_content


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("compression", ["", "zstd", "lz4"])
def test_our_own_hand_comes_back_as_near_as_float32_holds_it(side: Side, compression: str) -> None:
    sample = joint_sample(side)
    recording = read_content(Content(data=mcap_bytes(sample, side, compression=compression)), ReadOptions())
    assert (recording.form, recording.hand) == ("mcap", side)
    assert np.allclose(recording.time, sample.motion.time, atol=1e-9)
    # Centres are rounded to 2⁻²⁵ of half a metre; the shortest bone is 11 mm long.
    bound = 4.0 * 2.0**-25 / 0.011
    assert np.abs(recording.flexion - sample.motion.flexion).max() < 3.0 * bound
    assert np.allclose(recording.position, sample.motion.position, atol=1e-7)
    assert recording.bones is not None and recording.bones.radius is not None
    assert np.allclose(recording.bones.radius, sample.hand.radius, atol=1e-8)
    assert any("8.0 ms later in the median" in finding.text for finding in recording.findings)


def record(code: int, body: bytes) -> bytes:
    return struct.pack("<BQ", code, len(body)) + body


FOOTER = record(2, struct.pack("<QQI", 0, 0, 0))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data[:-20], "a damaged MCAP file: EndOfFile"),
        (lambda data: data.replace(b"HandPoseRecord", b"HeadPoseRecord"), "crc validation failed in Chunk"),
        (lambda data: data[:8] + data[-8:], "a damaged MCAP file: unpack requires"),
        (lambda data: data[:8] + FOOTER + data[-8:], "no hand among the channels, which are none"),
        (lambda data: data[:8] + struct.pack("<BQ", 1, 1 << 40) + data[17:], "exceeds limit"),
        (lambda data: b"x" + data[1:], "invalid magic"),
        (lambda data: data[:-12] + b"\0\0\0\1" + data[-8:], "the summary differs from its checksum"),
    ],
)
def test_a_damaged_file_is_refused(change: Any, said: str) -> None:
    with pytest.raises(TrajectoryError, match=said):
        read_as("mcap", change(mcap_bytes(joint_sample())))


def test_a_file_without_hands_says_what_it_holds() -> None:
    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    schema = record(3, struct.pack("<H", 1) + text("core.HeadPoseRecord") + text("flatbuffer") + text(""))
    channel = record(4, struct.pack("<HH", 1, 1) + text("head") + text("flatbuffer") + text(""))
    magic = b"\x89MCAP0\r\n"
    with pytest.raises(TrajectoryError, match=r"which are head \(core.HeadPoseRecord\); expected core.HandPoseRecord"):
        read_as("mcap", magic + schema + channel + FOOTER + magic)


@pytest.mark.parametrize("chunks", [0, 1, 3])
def test_numbers_are_proven_where_each_has_a_checksum_and_none_is_lost(chunks: int) -> None:
    sample = joint_sample()
    data = mcap_bytes(sample, chunks=chunks)
    assert read_as("mcap", data).checksums == "held"
    assert read_as("mcap", mcap_bytes(sample, chunks=chunks, checksums=False)).checksums == "missing"
    place = data.index(struct.pack("<f", sample.named()[20, 5, 0].astype(np.float32)))
    part = "Chunk" if chunks else "DataEnd"
    with pytest.raises(TrajectoryError, match=f"crc validation failed in {part}"):
        read_as("mcap", data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])


def test_what_unpacks_to_more_than_a_recording_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    data = mcap_bytes(joint_sample(), chunks=3, compression="zstd")
    monkeypatch.setattr(mcap, "MOST_SAMPLES", 30)
    with pytest.raises(TrajectoryError, match="more than 30 messages"):
        read_as("mcap", data)
    # No chunk alone is as large.
    monkeypatch.setattr(mcap, "MOST_BYTES", 20_000)
    with pytest.raises(TrajectoryError, match="chunks of more than 1 GB"):
        read_as("mcap", data)


def test_a_lost_chunk_is_told_by_the_statistics() -> None:
    data = mcap_bytes(joint_sample(), chunks=3)
    first = data.index(b"\x06", 8 + 9)
    second = first + 9 + struct.unpack_from("<Q", data, first + 1)[0]
    assert data[second] == 6
    # A kind of record that nobody knows is passed over, as the format asks.
    for damaged in (data[:second] + b"\x86" + data[second + 1 :], data[:second] + data[first:second] + data[second:]):
        with pytest.raises(TrajectoryError, match=r"in [24] chunks, where its statistics count 40 in 3"):
            read_as("mcap", damaged)
