"""Recordings of joint centres that test modules share: our own hand's motion in the files of those who track hands."""

import csv
import io
import json
import struct
import zlib
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from recording_samples import smooth_recording

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import rotation_matrix
from hhsim.motion.trajectory import HandSide
from hhsim.recordings.frames import world_matrix
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS, WEBXR_JOINTS
from hhsim.recordings.recording import Recording

Side = Literal["right", "left"]
Y_UP = world_matrix("y").T
"""From our world to one with y up."""


class JointSample(NamedTuple):
    """A motion that is known, and where its joints are.

    Attributes:
        hand: The hand that made it.
        motion: Its pose and angles.
        joints: The 26 of OpenXR [m], our world, shape (T, 26, 3).
        radius: Of each [m], shape (26,).
    """

    hand: HandModel
    motion: Recording
    joints: FloatArray
    radius: FloatArray

    def named(self, names: tuple[str, ...] = KEYPOINTS) -> FloatArray:
        """The joints of these names in a world with y up [m], shape (T, n, 3)."""
        return np.asarray(self.joints[:, [OPENXR_JOINTS.index(name) for name in names]] @ Y_UP.T)


@cache
def joint_sample(
    side: Side = "right", count: int = 40, noise: float = 0.0, length: float = 0.19, bend: float = 1.0
) -> JointSample:
    """A smooth motion of our own hand, with the joints moved at random by `noise` [m], and flexed less by `bend`."""
    hand = HandModel.default(side, hand_length=length)
    smooth = smooth_recording(count)
    flexion = bend * np.clip(smooth.flexion, hand.flexion_min, hand.flexion_max)
    abduction = np.clip(smooth.abduction, hand.abduction_min, hand.abduction_max)
    motion = smooth.changed(flexion=flexion, abduction=abduction, hand=side)
    mirror = -1.0 if side == "left" else 1.0
    wrist = np.array([-0.070 * hand.hand_breadth * mirror, -0.223 * hand.hand_length, 0.0])
    frames = []
    for k in range(count):
        fingers = hand.joints(motion.position[k], motion.orientation[k], flexion[k], abduction[k])
        turn = rotation_matrix(motion.orientation[k])
        at = {"wrist": motion.position[k] + turn @ wrist, "palm": motion.position[k]}
        for f, finger in enumerate(FINGERS):
            names = ("metacarpal", "proximal", "distal", "tip")
            if finger != "thumb":
                names = ("proximal", "intermediate", "distal", "tip")
                at[f"{finger}_metacarpal"] = 0.4 * fingers[f, 0] + 0.6 * at["wrist"]
            at |= {f"{finger}_{name}": fingers[f, j] for j, name in enumerate(names)}
        frames.append([at[name] for name in OPENXR_JOINTS])
    radii = {"wrist": 0.02, "palm": 0.015, **{f"{finger}_metacarpal": 0.018 for finger in FINGERS}}
    for f in range(5):
        ends = KEYPOINTS[1 + 4 * f : 5 + 4 * f]
        radii |= {name: float(hand.radius[f, j]) for j, name in enumerate(ends)}
    joints = np.array(frames)
    if noise:
        joints = joints + np.random.default_rng(5).normal(0.0, noise, joints.shape)
    return JointSample(hand, motion, joints, np.array([radii[name] for name in OPENXR_JOINTS]))


def openxr_csv(sample: JointSample, side: HandSide = "right", *, unity: bool = False, radii: bool = True) -> str:
    """A table of the 26 joints, stamps in ms; in Unity's world z points the other way."""
    points = sample.named(OPENXR_JOINTS) * ([1.0, 1.0, -1.0] if unity else [1.0, 1.0, 1.0])
    parts = ("x", "y", "z", "qx", "qy", "qz", "qw", *(("radius",) if radii else ()))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["frame", "timestamp_ms", *(f"{side}_{name}_{part}" for name in OPENXR_JOINTS for part in parts)])
    for k, stamp in enumerate(sample.motion.time):
        row: list[float] = [k, 1e3 * stamp]
        for point, radius in zip(points[k], sample.radius):
            row += [*point, 0.0, 0.0, 0.0, 1.0, *((radius,) if radii else ())]
        writer.writerow(map(repr, map(float, row)))
    return text.getvalue()


def webxr_json(sample: JointSample, side: Side = "right", *, unity: bool = False) -> str:
    """Frames of 25 named joints with position, quaternion and radius; in Unity's world z points the other way."""
    points = sample.named(WEBXR_JOINTS) * ([1.0, 1.0, -1.0] if unity else [1.0, 1.0, 1.0])
    radius = sample.radius[1:]
    frames = [
        {
            "timeStamp": 1e3 * float(stamp),
            "hands": {
                side: {
                    _webxr(name): {"position": dict(zip("xyz", point)), "quaternion": [0, 0, 0, 1], "radius": r}
                    for name, point, r in zip(WEBXR_JOINTS, points[k].tolist(), radius.tolist())
                }
            },
        }
        for k, stamp in enumerate(sample.motion.time)
    ]
    return json.dumps({"frames": frames})


def _webxr(name: str) -> str:
    finger, _, segment = name.partition("_")
    if not segment:
        return name
    bone = segment if segment in ("tip", "metacarpal") else f"phalanx-{segment}"
    return f"{finger}-{bone}" if finger == "thumb" else f"{finger.replace('little', 'pinky')}-finger-{bone}"


def iwer_json(sample: JointSample, side: Side = "right") -> str:
    """A recording of iwer: joints relative to a ray that turns, five numbers after the point here, three there."""
    from scipy.spatial.transform import Rotation

    points, radius = sample.named(WEBXR_JOINTS), sample.radius[1:]
    frames: list[Any] = []
    for k, stamp in enumerate(sample.motion.time):
        ray = Rotation.from_rotvec([0.1 * k, 0.4, -0.02 * k])
        origin = np.array([0.2, 1.0 + 0.01 * k, -0.3])
        local = ray.inv().apply(points[k] - origin)
        flat = [x for point, r in zip(local, radius) for x in (*point.tolist(), 0.0, 0.0, 0.0, 1.0, float(r))]
        source = [0, *origin.tolist(), *ray.as_quat().tolist(), flat]
        frames.append([1e3 * float(stamp), 0, 1.6, 0, 0, 0, 0, 1, source])
    schema = {"handedness": side, "hasGrip": False, "hasHand": True, "jointSequence": [*map(_webxr, WEBXR_JOINTS)]}
    return json.dumps({"schema": [[0, schema]], "frames": frames})


def mcap_bytes(
    sample: JointSample, side: Side = "right", *, compression: str = "", chunks: int = 1, checksums: bool = True
) -> bytes:
    """An MCAP file with one channel of core.HandPoseRecord, in chunks or, of 0 chunks, without.

    As the usual writers do, it has checksums of the chunks and of the summary, whose statistics count the messages;
    without chunks, of the data and of the summary.
    """
    points = sample.named(OPENXR_JOINTS).astype("<f4")

    def text(value: str) -> bytes:
        return struct.pack("<I", len(value)) + value.encode()

    def record(code: int, body: bytes) -> bytes:
        return struct.pack("<BQ", code, len(body)) + body

    schema = struct.pack("<H", 1) + text("core.HandPoseRecord") + text("flatbuffer") + struct.pack("<I", 0)
    channel = struct.pack("<HH", 1, 1) + text(f"hands/{side}_hand") + text("flatbuffer") + struct.pack("<I", 0)
    begin = record(0x03, schema) + record(0x04, channel)
    messages = []
    for k, stamp in enumerate(sample.motion.time):
        taken = 1_000_000_000 + round(1e9 * float(stamp))
        head = struct.pack("<HIQQ", 1, k, taken, taken)
        data = hand_record(points[k], sample.radius, (taken + 8_000_000, taken, taken + 77))
        messages.append(record(0x05, head + data))

    def chunk(inner: bytes) -> bytes:
        packed = inner
        if compression:
            from pyarrow import Codec

            packed = Codec(compression).compress(inner, asbytes=True)
        head = struct.pack("<QQQI", 0, 0, len(inner), checksums * zlib.crc32(inner)) + text(compression)
        return record(0x06, head + struct.pack("<Q", len(packed)) + packed)

    magic = b"\x89MCAP0\r\n"
    parts = np.array_split(np.arange(len(messages)), max(chunks, 1))
    content = [begin * (k == 0) + b"".join(messages[each] for each in part) for k, part in enumerate(parts)]
    file = magic + record(0x01, text("") + text("test")) + b"".join(map(chunk, content) if chunks else content)
    file += record(0x0F, struct.pack("<I", checksums * (chunks == 0) * zlib.crc32(file)))
    counts = struct.pack("<QHIIIIQQI", len(messages), 1, 1, 0, 0, chunks, 0, 0, 0)
    summary = record(0x0B, counts) + struct.pack("<BQQQ", 0x02, 20, len(file), 0)
    return file + summary + struct.pack("<I", checksums * zlib.crc32(summary)) + magic


def hand_record(points: NDArray[np.float32], radius: FloatArray, stamps: tuple[int, int, int]) -> bytes:
    """A FlatBuffers table of a table with 26 joints, and of three stamps."""
    joints = b"".join(
        struct.pack("<7fB3xf", *point.tolist(), 0.0, 0.0, 0.0, 1.0, 1, r) for point, r in zip(points, radius.tolist())
    )
    # The root's table at 16, its list of fields at 4; the hand's table after the stamps.
    root_fields = struct.pack("<HHHH", 8, 32, 4, 8)
    hand_fields = struct.pack("<HHH", 6, 4 + len(joints), 4)
    root, hand = 16, 16 + 32 + 8
    data = struct.pack("<I", root) + root_fields + b"\0" * 4
    data += struct.pack("<i", root - 4) + struct.pack("<I", hand - (root + 4)) + struct.pack("<qqq", *stamps)
    data += hand_fields + b"\0\0"
    return data + struct.pack("<i", hand - (hand - 8)) + joints


def arrays_npz(**arrays: Any) -> bytes:
    """An archive of arrays."""
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def array_npy(array: Any) -> bytes:
    """One array."""
    stream = io.BytesIO()
    np.save(stream, np.asarray(array))
    return stream.getvalue()


def words(recording: Recording) -> str:
    """All that its reader has to say of a recording."""
    return " | ".join(finding.text for finding in recording.findings)


def assert_our_own(recording: Recording, sample: JointSample) -> None:
    """The motion is the sample's."""
    assert np.abs(recording.flexion - sample.motion.flexion).max() < 1e-6
    assert np.abs(recording.abduction - sample.motion.abduction).max() < 1e-6
    assert np.allclose(recording.position, sample.motion.position, atol=1e-9)
