"""Hands in MCAP as Isaac Teleop records them: channels left_hand and right_hand of the FlatBuffers core.HandPoseRecord.

A record holds 26 joints of OpenXR (position, quaternion, validity, radius) and three stamps: arrival and sampling on
the host's clock, and sampling on the device's. The second is used. y is up. mcap (mcap.dev) reads the file, in a child
process; the layout of a record is published at flatbuffers.dev. CRC-32 of chunks and data, and the number of messages
in the statistics, are checked where they are there.
"""

import io
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.errors import TrajectoryError
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS, joint_name
from hhsim.recordings.recording import MOST_SAMPLES
from hhsim.recordings.registry import Content, JointPositions, ReadOptions, RecordingFormat
from hhsim.system.child_reader import read_in_child
from hhsim.system.counted import counted

MAGIC = b"\x89MCAP0\r\n"
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
Sample = tuple[tuple[int, ...], NDArray[np.void] | None]
"""Stamps [ns], and the joints if the hand was seen."""


def _read(content: Content, options: ReadOptions) -> JointPositions:
    """Read the hand of the options, else the one with more samples; raises TrajectoryError."""
    import mcap.stream_reader  # noqa: F401

    data = content.data
    channels, samples = read_in_child(lambda: _channels_and_hands(data), "a damaged MCAP file", len(data))
    if not samples:
        held = ", ".join(sorted({f"{topic} ({schema or 'no schema'})" for topic, schema in channels})[:4])
        what = f"no hand among the channels, which are {held or 'none'}"
        raise TrajectoryError(f"{what}; expected {HAND_SCHEMA} on left_hand or right_hand")
    seen = {side: [k for k, sample in enumerate(each) if sample[1] is not None] for side, each in samples.items()}
    side = content.chosen_side({side: len(rows) for side, rows in seen.items()}, options.hand)
    content.unused(
        dict.fromkeys(topic for topic, schema in channels if not joint_name(topic).side or schema != HAND_SCHEMA)
    )
    total, shown = len(samples[side]), [samples[side][k] for k in seen[side]]
    if not shown:
        raise TrajectoryError(f"{total} samples of the {side} hand, and none in which it was seen")
    if len(shown) < total:
        content.note(f"{total - len(shown)} of {total} frames show no {side} hand: no samples")
    stamped = all(len(stamps) == 3 for stamps, _ in shown)
    given = np.array([stamps[1 if stamped else -1] for stamps, _ in shown], dtype=np.int64)
    logged = "when the messages were logged; the records have no others"
    content.note("stamps: " + ("when the sample was taken, host's clock" if stamped else logged))
    joints = np.array([joints for _, joints in shown])
    places = [OPENXR_JOINTS.index(joint) for joint in KEYPOINTS]
    with np.errstate(invalid="ignore"):
        position, radius = (joints[key][:, places].astype(np.float64) for key in ("position", "radius"))
    known = bool((np.nan_to_num(radius) > 0.0).any(axis=0).all())
    return JointPositions(
        position=position,
        what=f"{len(OPENXR_JOINTS)} OpenXR joints of the {side} hand",
        time=(given - given[0]) * NANOSECOND,
        time_unit="s",
        hand=side,
        unit=1.0,
        up="y",
        radius=radius if known else None,
        validity={"valid": joints["valid"][:, places].astype(np.float64)},
        device="OpenXR through Isaac Teleop",
        rows=seen[side],
    )


def _channels_and_hands(data: bytes) -> tuple[list[tuple[str, str]], dict[HandSide, list[Sample]]]:
    """Return topic and schema of each channel, and the samples of each hand; ValueError, struct.error for damage."""
    from mcap.records import Channel, Message, Schema, Statistics
    from mcap.stream_reader import StreamReader

    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str]] = {}
    hands: dict[HandSide, list[Sample]] = {}
    messages = 0
    reader: Any = StreamReader(io.BytesIO(data), validate_crcs=True, record_size_limit=len(data))
    for record in reader.records:
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            channels[record.id] = record.topic, schemas.get(record.schema_id, "")
        elif isinstance(record, Message):
            messages += 1
            if messages > MOST_SAMPLES:
                raise TrajectoryError(f"more than {MOST_SAMPLES:,} messages; expected a recording of a hand")
            topic, schema = channels.get(record.channel_id, ("", ""))
            if schema == HAND_SCHEMA and (side := joint_name(topic).side):
                hands.setdefault(side, []).append(_sample(record.log_time, record.data))
        elif isinstance(record, Statistics) and record.message_count != messages:
            raise ValueError(f"{counted(messages, 'message')}, where its statistics count {record.message_count}")
    return [*channels.values()], hands


def _sample(log_time: int, data: bytes) -> Sample:
    """Return stamps and joints of a record: a FlatBuffers table of a table and a struct of three stamps."""
    (root,) = struct.unpack_from("<I", data)
    stamp, hand = _field(data, root, 1), _field(data, root, 0)
    stamps = struct.unpack_from("<qqq", data, stamp) if stamp else (log_time,)
    joints = hand and _field(data, hand + struct.unpack_from("<I", data, hand)[0], 0)
    return stamps, np.frombuffer(data, JOINT, len(OPENXR_JOINTS), joints) if joints else None


def _field(data: bytes, table: int, index: int) -> int:
    """Return the place of a table's field; 0 where it is left out."""
    (back,) = struct.unpack_from("<i", data, table)
    if back > table:
        raise ValueError("a table whose fields are before its record")
    (size,) = struct.unpack_from("<H", data, table - back)
    place = 4 + 2 * index
    (offset,) = struct.unpack_from("<H", data, table - back + place) if place < size else (0,)
    return table + offset if offset else 0


FORMAT = RecordingFormat(
    "mcap",
    "MCAP with the hands of OpenXR, as Isaac Teleop records them",
    (".mcap",),
    lambda content, options: content.head.startswith(MAGIC),
    _read,
)
