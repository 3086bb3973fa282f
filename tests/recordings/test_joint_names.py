"""Names of joints, stamps, statements on joints and fields beside samples, as makers write them, in every file."""

import json
import pickle
from typing import Any

import numpy as np
import pytest
from joint_samples import arrays_npz, assert_our_own, joint_sample, openxr_csv, webxr_json, words
from pose_samples import lerobot_bytes
from recording_samples import read_as

from hhsim.errors import TrajectoryError
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.joint_names import KEYPOINTS, MANO_JOINTS, OPENXR_JOINTS, StatedFields, joint_name
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content, ReadOptions, read_content
from hhsim.recordings.unit_detection import TimeColumn, time_column


@pytest.mark.parametrize(
    ("seconds", "fraction", "expected"),
    [
        ([5, 6], [900_000_000, 100_000_000], [5.9e9, 6.1e9]),
        # Two clocks of one name: each has the whole stamp.
        ([5.9, 6.1], [5_900_000_000, 6_100_000_000], [5.9e9, 6.1e9]),
        ([0.25, 0.5], [250_000_000, 500_000_000], [0.25e9, 0.5e9]),
    ],
)
def test_seconds_and_nanoseconds_make_one_stamp(
    seconds: list[float], fraction: list[float], expected: list[float]
) -> None:
    held = {"sec": np.array(seconds, float), "nanosec": np.array(fraction, float)}
    column = time_column(held)
    assert column.stamps(held.__getitem__).tolist() == expected


def test_what_a_name_says() -> None:
    said = {
        "left_index_tip_x": ("left", "index_tip", "x"),
        "XR_HAND_JOINT_INDEX_TIP_EXT": ("", "index_tip", ""),
        "index-finger-phalanx-proximal": ("", "index_proximal", ""),
        "pinky-finger-metacarpal": ("", "little_metacarpal", ""),
        "R_IndexTip.PosX": ("right", "index_tip", "x"),
        "RightHandThumbDistal_pz": ("right", "thumb_distal", "z"),
        "INDEX_FINGER_MCP_y": ("", "index_proximal", "y"),
        "THUMB_IP": ("", "thumb_distal", ""),
        "right_wrist_qx": ("right", "wrist", "rotation"),
        "left_palm_radius": ("left", "palm", "radius"),
        "LeftMiddleProximalRotationX": ("left", "middle_proximal", "rotation"),
        "ring_tip_valid": ("", "ring_tip", "valid"),
        "left_ring_tip_locationFlags": ("left", "ring_tip", "flags"),
        "R_IndexTip.isTracked": ("right", "index_tip", "tracked"),
        "right_palm_positionValid": ("right", "palm", "valid"),
        "right_palm_orientationValid": ("right", "palm", ""),
        "thumb_intermediate_x": ("", "", "x"),
        "emg_3": ("", "", ""),
    }
    assert {text: joint_name(text) for text in said} == said


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["x", "y"], TimeColumn()),
        (["frame", "t"], TimeColumn("t", None)),
        (["timestamp_ms", "x"], TimeColumn("timestamp_ms", "ms")),
        (["Time [s]"], TimeColumn("Time [s]", "s")),
        (["timestampNs"], TimeColumn("timestampNs", "ns")),
        (["time_seconds"], TimeColumn("time_seconds", "s")),
        (["time_of_day", "host_time", "device_time_us"], TimeColumn("device_time_us", "us", ("host_time",))),
        (["stampNanoSec"], TimeColumn("stampNanoSec", "ns")),
        (
            ["header.stamp.sec", "header.stamp.nanosec"],
            TimeColumn("header.stamp.sec", "ns", (), "header.stamp.nanosec"),
        ),
        (["stamp_nsecs", "x", "stamp_secs"], TimeColumn("stamp_secs", "ns", (), "stamp_nsecs")),
        (["tv_sec", "tv_usec"], TimeColumn("tv_sec", "us", (), "tv_usec")),
        (["seconds", "nanos"], TimeColumn("seconds", "ns", (), "nanos")),
        (["device_time_s", "stamp_sec", "stamp_nsec"], TimeColumn("device_time_s", "s", ("stamp_sec", "stamp_nsec"))),
        (["x_s", "y_ns"], TimeColumn()),
    ],
)
def test_the_stamps_are_found_with_their_unit(names: list[str], found: TimeColumn) -> None:
    assert time_column(names) == found


SAMPLE, LEFT = joint_sample(), joint_sample("left")
TIME, COUNT = SAMPLE.motion.time, len(SAMPLE.motion.time)
NONE = {"poses": np.zeros(3)}


def read(data: bytes, **options: Any) -> Recording:
    return read_content(Content(data=data), ReadOptions(world_up="y", **options))


@pytest.mark.parametrize(
    ("name", "value", "kind", "wanted"),
    [
        *((name, value, "side", "right") for name in ("hand", "side", "Handedness", "meta/hand_side", "handSide")
          for value in ("right", "Right Hand", b"right", np.array(["R"]), ["rhand"] * 3, ["right", "", "right"])),
        *((name, value, "side", "right") for name in ("is_right", "is_rhand", "isRight", "hands.is_right_hand")
          for value in (1, True, 1.0, "1", "true", np.array([1]), np.ones(5), [True, True])),
        *((name, value, "side", "left") for name in ("is_right", "is_rhand")
          for value in (0, False, np.zeros((4, 1)))),
        *((name, value, "side", "left") for name in ("is_left", "is_lhand") for value in (1, [1.0, np.nan])),
        ("hand", "l", "side", "left"),
        ("is_right", [1, 0, 1], "side", "both"),
        ("hand", 1, "side", None),
        ("hand", "both", "side", None),
        ("is_right", 0.7, "side", None),
        ("hand", {"right": 1}, "side", None),
        *((name, 30, "rate", 30.0) for name in
          ("fps", "rate", "frequency", "mocap_frame_rate", "framerate", "frameRate")),
        ("fps", "29.97", "rate", 29.97),
        ("fps", [30, 30], "rate", None),
        ("fps", 0, "rate", None),
        ("rate", "fast", "rate", None),
        ("unit", "mm", "unit", 1e-3),
        ("units", b"Millimetres", "unit", 1e-3),
        ("length_unit", "inches", "unit", 0.0254),
        ("unit", "meter", "unit", 1.0),
        ("unit", 0.01, "unit", 0.01),
        ("unit", "furlong", "unit", None),
        ("unit", -1.0, "unit", None),
        ("joint_names", list(KEYPOINTS), "order", KEYPOINTS),
        ("joint_order", " ".join(KEYPOINTS), "order", KEYPOINTS),
        ("joint_names", [*KEYPOINTS[:-1], "x"], "order", None),
    ],
)  # fmt: skip
def test_what_a_field_says(name: str, value: Any, kind: str, wanted: Any) -> None:
    fields = StatedFields(NONE | {name: value})
    assert fields.seen(kind) == wanted
    assert fields.told() == [f"not used: {name}"]
    assert fields.take(kind) == wanted and fields.take("rate" if kind != "rate" else "unit") is None
    (told,) = fields.told()
    assert told == f"not used: {name}" if wanted is None else told.endswith(f", as '{name}' says")


def test_of_two_of_a_kind_the_first_counts_and_the_other_is_told() -> None:
    fields = StatedFields({"fps": 30.0, "mocap_frame_rate": 120.0, "a.fps": "x"})
    assert fields.take("rate") == 30.0
    assert fields.told() == ["30 samples a second, as 'fps' says", "not used: mocap_frame_rate, a.fps"]


POINTS = SAMPLE.named()
HELD: dict[str, Any] = {"fps": 50, "hand": "right", "unit": "mm", "joint_order": "mediapipe"}
ROWS = {f"{axis}{k}": 1e3 * POINTS[:, k, a] for k in range(21) for a, axis in enumerate("xyz")}


def a_table(**columns: Any) -> bytes:
    remarks = "".join(f"# {key}: {value}\n" for key, value in HELD.items() if key not in columns)
    cells = zip(*(np.broadcast_to(values, COUNT).tolist() for values in (ROWS | columns).values()))
    lines = [",".join(ROWS | columns), *(",".join(map(str, row)) for row in cells)]
    return (remarks + "\n".join(lines) + "\n").encode()


STATED = {
    "npz": arrays_npz(points=1e3 * POINTS, **HELD),
    "npz, meta": arrays_npz(points=1e3 * POINTS, meta=np.array(json.dumps(HELD))),
    "pickle": pickle.dumps({"points": 1e3 * POINTS, "by": {"who": "me", **HELD}}),
    "pickle of texts as bytes": pickle.dumps({"points": 1e3 * POINTS, **HELD, "hand": b"right"}),
    "json": json.dumps({"info": HELD, "frames": [{"landmarks": p} for p in (1e3 * POINTS).tolist()]}).encode(),
    "csv, remarks": a_table(),
    "csv, column of texts": a_table(hand="Right"),
    "csv, column of numbers": a_table(is_right=1, hand=""),
}


@pytest.mark.parametrize("form", STATED)
def test_every_container_states_side_rate_unit_and_order(form: str) -> None:
    recording = read(STATED[form])
    assert_our_own(recording, SAMPLE)
    assert recording.hand == "right" and np.allclose(recording.time, np.arange(COUNT) / 50.0)
    told = words(recording)
    for text in ("right hand", "50 samples a second", "positions in mm", "joints in the order of the file"):
        assert f"{text}, as '" in told, told
    assert "by the bend" not in told and "no unit named" not in told
    # What the user says goes before.
    other = read(STATED[form], rate=100.0, joint_order="mediapipe")
    assert np.allclose(other.time, np.arange(COUNT) / 100.0) and "as 'fps' says" not in words(other)
    with pytest.raises(TrajectoryError, match=r"named a left hand, .* as a right one's: .*, --hand right if it is"):
        read(STATED[form], hand="left")


def test_frames_and_columns_of_a_table_name_their_hand() -> None:
    frames = [{"t": t, "is_right": 1, "landmarks": p} for t, p in zip(TIME.tolist(), POINTS.tolist())]
    recording = read(json.dumps(frames).encode())
    assert recording.hand == "right" and "the file does not say" not in words(recording)
    unnamed = webxr_json(SAMPLE).replace('"right"', '"hand_a"')
    assert read_as("webxr", unnamed.replace('{"timeStamp"', '{"handedness": "right", "timeStamp"')).hand == "right"
    text = openxr_csv(SAMPLE).replace("right_", "").splitlines()
    table = "\n".join([f"side,{text[0]}", *(f"Right,{line}" for line in text[1:])]) + "\n"
    assert "right hand, as 'side' says" in words(read_as("openxr", table))
    assert "the file does not say" in words(read_as("openxr", "\n".join(text) + "\n"))


def test_a_field_of_both_hands_is_refused() -> None:
    with pytest.raises(TrajectoryError, match="states right and left hands; expected the samples of one hand alone"):
        read(arrays_npz(keypoints=POINTS, t=TIME, is_right=np.arange(COUNT) % 2))


def test_recordings_of_angles_take_side_rate_and_unit() -> None:
    motion = SAMPLE.motion
    palm = {"wrist_pos": 1e3 * motion.position, "wrist_quat": motion.orientation}
    arrays = {**palm, "flex": motion.flexion, "abd": motion.abduction}
    recording = read_as("npz", arrays_npz(**arrays, handedness=b"left", mocap_frame_rate=60.0, units="mm"))
    assert recording.hand == "left" and np.allclose(recording.time, np.arange(COUNT) / 60.0)
    np.testing.assert_allclose(recording.position, motion.position, atol=1e-12)
    assert "length" in recording.stated and "60 samples a second, as 'mocap_frame_rate' says" in words(recording)
    # An object whose names say its unit has that one, whatever the unit of the hand.
    beside = {"object_pos_cm": 100.0 * motion.position, "object_quat": motion.orientation}
    recording = read_as("npz", arrays_npz(**arrays, **beside, t=TIME, units="mm"))
    np.testing.assert_allclose(recording.object_motion.position, recording.position, atol=1e-12)


def test_a_rate_beside_stamps_is_not_used() -> None:
    assert "not used: fps" in words(read(arrays_npz(keypoints=POINTS, t=TIME, fps=30)))


def test_a_data_set_of_one_hand_names_it_in_a_column() -> None:
    import pyarrow
    from pyarrow import parquet

    table = parquet.read_table(pyarrow.BufferReader(lerobot_bytes(SAMPLE)))
    one = pyarrow.array([row[1] for row in table["observation.hand_joints"].to_pylist()])
    table = table.set_column(table.column_names.index("observation.hand_joints"), "observation.hand_joints", one)
    table = table.append_column("observation.is_right", pyarrow.array([True] * COUNT))
    out = pyarrow.BufferOutputStream()
    parquet.write_table(table, out)
    recording = read_as("lerobot", out.getvalue().to_pybytes())
    assert recording.hand == "right" and "right hand, as 'observation.is_right' says" in words(recording)


LOST = [7, 8]
"""Samples without a valid position."""
WHERE = [k in LOST for k in range(40)]


def assert_lost(recording: Recording, finger: int | None) -> None:
    """Assert that the samples `LOST` of a finger, or of the whole hand, are missing, and no others."""
    fingers = range(5) if finger is None else [finger]
    lost = [[sample, each] for sample in LOST for each in fingers]
    assert np.argwhere(np.isnan(recording.abduction)).tolist() == lost
    assert np.flatnonzero(np.isnan(recording.position).any(axis=1)).tolist() == (LOST if finger is None else [])
    assert np.flatnonzero(marked(recording.flags, SampleFlag.INVALID)).tolist() == LOST
    assert "joints without a valid position, says the device: missing" in words(recording)


def with_column(name: str, good: str, bad: str) -> str:
    header, *rows = openxr_csv(SAMPLE).splitlines()
    cells = [bad if lost else good for lost in WHERE]
    return "\n".join([f"{header},{name}", *(f"{row},{cell}" for row, cell in zip(rows, cells))]) + "\n"


@pytest.mark.parametrize(
    ("name", "good", "bad", "finger"),
    [
        ("right_index_tip_locationFlags", "15", "1", 1),
        ("right_index_tip_flags", "0xf", "0x0", 1),
        ("right_index_tip_isValid", "True", "False", 1),
        ("right_index_tip_tracked", "1", "0", 1),
        ("right_index_tip_confidence", "0.9", "0", 1),
        ("right_isActive", "1", "0", None),
        ("right_hand_is_tracked", "true", "false", None),
        ("valid", "1.0", "0.0", None),
        ("right_confidence", "High", "-1", None),
    ],
)
def test_a_column_that_states_it(name: str, good: str, bad: str, finger: int | None) -> None:
    recording = read_as("openxr", with_column(name, good, bad))
    assert_lost(recording, finger)
    assert not any(name in each.text for each in recording.findings if each.text.startswith("not used"))


@pytest.mark.parametrize("name", ["left_isActive", "head_isTracked", "right_index_tip_orientationValid", "eye_valid"])
def test_a_column_that_states_something_else_is_not_taken(name: str) -> None:
    recording = read_as("openxr", with_column(name, "1", "0"))
    assert np.isfinite(recording.abduction).all() and not recording.flags.any()


@pytest.mark.parametrize(
    ("key", "good", "bad", "at"),
    [
        ("locationFlags", 15, 13, "joint"),
        ("isValid", True, False, "joint"),
        ("isActive", True, False, "hand"),
        ("tracked", 1, 0, "hand"),
        ("right_isActive", True, False, "frame"),
    ],
)
def test_a_key_that_states_it(key: str, good: Any, bad: Any, at: str) -> None:
    document = json.loads(webxr_json(SAMPLE))
    for frame, lost in zip(document["frames"], WHERE):
        hand = frame["hands"]["right"]
        {"joint": hand["index-finger-tip"], "hand": hand, "frame": frame}[at][key] = bad if lost else good
    recording = read_as("webxr", json.dumps(document))
    assert_lost(recording, 1 if at == "joint" else None)
    assert key not in words(recording).partition("not used:")[2]


@pytest.mark.parametrize("names", [KEYPOINTS, MANO_JOINTS, OPENXR_JOINTS])
def test_an_array_that_states_it(names: tuple[str, ...]) -> None:
    points, time = SAMPLE.named(names), SAMPLE.motion.time
    of_joints = np.ones((40, len(names)))
    of_joints[LOST, names.index("index_tip")] = 0.0
    for values, finger in ((of_joints, 1), (~np.array(WHERE), None)):
        data = arrays_npz(joints=points, t=time, is_valid=values, joint_names=names)
        assert_lost(read_as("keypoints", data, world_up="y"), finger)


def test_a_file_that_says_that_no_joint_is_valid_is_refused() -> None:
    with pytest.raises(TrajectoryError, match=r"no joint has a valid position in any sample, says the file \(valid\)"):
        read_as("openxr", with_column("right_isActive", "0", "0"))
