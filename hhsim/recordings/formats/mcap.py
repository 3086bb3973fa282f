"""Hands in MCAP as Isaac Teleop records them: channels left_hand and right_hand of the FlatBuffers core.HandPoseRecord.

A record holds 26 joints of OpenXR (position, quaternion, validity, radius) and three stamps: arrival and sampling on
the host's clock, and sampling on the device's. The second is used. y is up. The layouts are published at mcap.dev and
flatbuffers.dev. pyarrow unpacks compressed chunks. All CRC-32 and statistics that are there are checked.
"""

import re
import struct
import zlib
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS
from hhsim.recordings.joint_positions import JointPositions, recording_of_joints
from hhsim.recordings.recording import MOST_SAMPLES, Finding, Recording, chosen_side, note, unused
from hhsim.recordings.registry import MOST_BYTES, Content, ReadOptions, RecordingFormat
from hhsim.system.counted import counted

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, STATISTICS, DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0B, 0x0F
HAND_SCHEMA = "core.HandPoseRecord"
JOINT = np.dtype(
    {
        "names": ["position", "orientation", "valid", "radius"],
        "formats": [("<f4", 3), ("<f4", 4), "u1", "<f4"],
        "offsets": [0, 12, 28, 32],
        "itemsize": 36,
    }
)
"""Joint of a record: position, quaternion, validity, radius, aligned to four bytes."""
NANOSECOND = 1e-9


class _Sample(NamedTuple):
    """Stamps, and the joints if the hand was seen."""

    stamps: tuple[int, ...]
    joints: NDArray[np.void] | None


def _read(content: Content, options: ReadOptions) -> Recording:
    """Read the hand of the options, else the one with more samples; raises TrajectoryError."""
    records, proved = _records(content.data)
    samples, others = _samples(records)
    seen = {side: sum(sample.joints is not None for sample in each) for side, each in samples.items()}
    side, findings = chosen_side(seen, options.hand)
    findings += unused(dict.fromkeys(others))
    shown = [sample for sample in samples[side] if sample.joints is not None]
    if not shown:
        raise TrajectoryError(f"{len(samples[side])} samples of the {side} hand, and none in which it was seen")
    if lost := len(samples[side]) - len(shown):
        findings.append(note(f"{lost} of {len(samples[side])} frames show no {side} hand: no samples"))
    joints = np.array([sample.joints for sample in shown])
    places = [OPENXR_JOINTS.index(joint) for joint in KEYPOINTS]
    with np.errstate(invalid="ignore"):
        position, radius = (joints[key][:, places].astype(np.float64) for key in ("position", "radius"))
    known = bool((np.nan_to_num(radius) > 0.0).any(axis=0).all())
    positions = JointPositions(
        position=position,
        form="mcap",
        what=f"{len(OPENXR_JOINTS)} OpenXR joints of the {side} hand",
        time=_stamps([sample.stamps for sample in shown], findings),
        time_unit="s",
        hand=side,
        unit=1.0,
        up="y",
        radius=radius if known else None,
        validity={"valid": joints["valid"][:, places].astype(np.float64)},
        joint_order=tuple(places),
        device="OpenXR through Isaac Teleop",
        findings=tuple(findings),
        rows=[k for k, sample in enumerate(samples[side]) if sample.joints is not None],
    )
    return recording_of_joints(positions, content, options).changed(checksums="held" if proved else "")


def _samples(records: list[tuple[int, bytes]]) -> tuple[dict[HandSide, list[_Sample]], list[str]]:
    """Return the samples of each hand, and the other topics; raise TrajectoryError if there are no samples."""
    channels: dict[int, tuple[str, str]] = {}
    samples: dict[HandSide, list[_Sample]] = {}
    schemas: dict[int, str] = {}
    for code, body in records:
        if code == SCHEMA:
            (number,) = _unpack("<H", body, 0)
            schemas[number] = _text(body, 2)[0]
        elif code == CHANNEL:
            number, schema = _unpack("<HH", body, 0)
            channels[number] = (_text(body, 4)[0], schemas.get(schema, ""))
        elif code == MESSAGE:
            number, _, log_time, _ = _unpack("<HIQQ", body, 0)
            topic, schema_name = channels.get(number, ("", ""))
            side = _side(topic)
            if schema_name == HAND_SCHEMA and side:
                samples.setdefault(side, []).append(_sample(log_time, body[22:]))
    if not samples:
        held = ", ".join(sorted({f"{topic} ({schema or 'no schema'})" for topic, schema in channels.values()})[:4])
        raise TrajectoryError(
            f"no hand among the channels, which are {held or 'none'}; expected {HAND_SCHEMA} on left_hand or right_hand"
        )
    others = [topic for topic, schema in channels.values() if not _side(topic) or schema != HAND_SCHEMA]
    return samples, others


def _side(topic: str) -> HandSide:
    words = re.findall("[a-z]+", topic.lower())
    return "right" if "right" in words else "left" if "left" in words else ""


def _stamps(stamps: list[tuple[int, ...]], findings: list[Finding]) -> FloatArray:
    """Return the time of each sample after the first [s]."""
    if all(len(each) == 3 for each in stamps):
        there, taken, device = np.array(stamps, dtype=np.int64).T
        own, host = (device - device[0]) * NANOSECOND, (taken - taken[0]) * NANOSECOND
        late = 1e3 * NANOSECOND * float(np.median(there - taken))
        text = f"stamps: when the sample was taken, host's clock; there {late:.1f} ms later in the median"
        if device.any():
            text += f", off the device's clock by up to {1e3 * float(np.abs(own - host).max()):.1f} ms"
        findings.append(note(text))
        return np.asarray(host)
    logged = np.array([each[-1] for each in stamps], dtype=np.int64)
    findings.append(note("stamps: when the messages were logged; the records have no others"))
    return np.asarray((logged - logged[0]) * NANOSECOND)


def _records(data: bytes) -> tuple[list[tuple[int, bytes]], bool]:
    """Return every record with its code, also of chunks, and if checksums prove all; TrajectoryError if damaged."""
    if not data.startswith(MAGIC) or not data.endswith(MAGIC):
        raise TrajectoryError("a damaged MCAP file: it does not begin and end as one; was it cut short?")
    records: list[tuple[int, bytes]] = []
    chunks = unpacked = code = 0
    each_held, whole_held, statistics_hold = True, False, False
    for place, code, body in _walk(data, len(MAGIC), len(data) - len(MAGIC)):
        if code == CHUNK:
            inner, checked = _chunk(body, MOST_BYTES - unpacked)
            unpacked += len(inner)
            each_held, chunks = each_held and checked, chunks + 1
            for _, code_inside, body_inside in _walk(inner, 0, len(inner)):
                records.append((code_inside, body_inside))
                if len(records) > MOST_SAMPLES:
                    raise TrajectoryError(f"more than {MOST_SAMPLES:,} records; expected a recording of a hand")
            continue
        records.append((code, body))
        if code == MESSAGE:
            each_held = False
        elif code == DATA_END:
            whole_held = _agrees(memoryview(data)[:place], _unpack("<I", body, 0)[0], "the data")
        elif code == STATISTICS:
            stated, _, _, _, _, stated_chunks = _unpack("<QHIIII", body, 0)
            messages, statistics_hold = sum(kind == MESSAGE for kind, _ in records), True
            if (stated, stated_chunks) != (messages, chunks):
                raise TrajectoryError(
                    f"a damaged MCAP file: {counted(messages, 'message')} in {counted(chunks, 'chunk')}, where its "
                    f"statistics count {stated} in {stated_chunks}"
                )
        elif code == FOOTER:
            start, _, checksum = _unpack("<QQI", body, 0)
            _agrees(memoryview(data)[start or place : place + 25], checksum, "the summary")
    if code != FOOTER:
        raise TrajectoryError("a damaged MCAP file: no footer at its end; was it cut short?")
    return records, whole_held or (each_held and statistics_hold)


def _walk(data: bytes, place: int, end: int) -> Iterator[tuple[int, int, bytes]]:
    """Yield place, code and content of each record."""
    while place < end:
        (code, length) = _unpack("<BQ", data, place)
        if place + 9 + length > end:
            raise TrajectoryError(
                f"a damaged MCAP file: record at byte {place} ends beyond the file; was it cut short?"
            )
        yield place, code, data[place + 9 : place + 9 + length]
        place += 9 + length


def _agrees(data: bytes | memoryview, checksum: int, what: str) -> bool:
    """True if a part of the file has a checksum; TrajectoryError where it differs."""
    if checksum and zlib.crc32(data) != checksum:
        raise TrajectoryError(f"a damaged MCAP file: {what} differs from its checksum")
    return checksum != 0


def _chunk(body: bytes, most: int) -> tuple[bytes, bool]:
    """Unpack the records of a chunk, at most so many bytes, and tell whether they have a checksum."""
    size, checksum = _unpack("<QI", body, 16)
    compression, place = _text(body, 28)
    (length,) = _unpack("<Q", body, place)
    packed = body[place + 8 : place + 8 + length]
    if size > most:
        raise TrajectoryError("chunks of more than 1 GB; expected a recording of a hand")
    if compression:
        try:
            from pyarrow import Codec
        except ImportError:
            raise TrajectoryError(f"an MCAP file packed by {compression}: pip install pyarrow") from None
        try:
            packed = Codec(compression).decompress(packed, size, asbytes=True)
        except (ValueError, OSError, MemoryError, OverflowError) as error:
            reason = str(error).splitlines()[0][:80] if str(error) else type(error).__name__
            raise TrajectoryError(f"a damaged MCAP file: a chunk of {compression[:20]!r}: {reason}") from None
    if len(packed) != size:
        raise TrajectoryError(f"a damaged MCAP file: a chunk of {len(packed)} bytes, where {size} are stated")
    return packed, _agrees(packed, checksum, "a chunk")


def _sample(log_time: int, data: bytes) -> _Sample:
    """Return stamps and joints of a record: a FlatBuffers table of a table and a struct of three stamps."""
    (root,) = _unpack("<I", data, 0)
    stamp, hand = _field(data, root, 1), _field(data, root, 0)
    stamps = _unpack("<qqq", data, stamp) if stamp else (log_time,)
    joints = hand and _field(data, hand + _unpack("<I", data, hand)[0], 0)
    if not joints:
        return _Sample(stamps, None)
    if joints + len(OPENXR_JOINTS) * JOINT.itemsize > len(data):
        raise TrajectoryError("a damaged MCAP file: a hand ends beyond its message")
    return _Sample(stamps, np.frombuffer(data, JOINT, len(OPENXR_JOINTS), joints))


def _field(data: bytes, table: int, index: int) -> int:
    """Return the place of a table's field; 0 where it is left out."""
    (back,) = _unpack("<i", data, table)
    (size,) = _unpack("<H", data, table - back)
    if 4 + 2 * index >= size:
        return 0
    (offset,) = _unpack("<H", data, table - back + 4 + 2 * index)
    return table + offset if offset else 0


def _unpack(form: str, data: bytes, place: int) -> tuple[int, ...]:
    try:
        if place < 0:
            raise struct.error
        return struct.unpack_from(form, data, place)
    except struct.error:
        raise TrajectoryError("a damaged MCAP file: a number beyond the end of its record") from None


def _text(data: bytes, place: int) -> tuple[str, int]:
    """Return a text with its length before it, and its end."""
    (length,) = _unpack("<I", data, place)
    end = place + 4 + length
    if end > len(data):
        raise TrajectoryError("a damaged MCAP file: a text beyond the end of its record")
    return data[place + 4 : end].decode("utf-8", errors="replace"), end


FORMAT = RecordingFormat(
    "mcap",
    "MCAP with the hands of OpenXR, as Isaac Teleop records them",
    (".mcap",),
    lambda content, options: content.head.startswith(MAGIC),
    _read,
)
