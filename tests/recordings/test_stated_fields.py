"""Fields beside the samples: what they say, in every kind of file that can hold them, and what is told of them."""

import json
import pickle
from typing import Any

import numpy as np
import pytest
from joint_samples import arrays_npz, assert_our_own, joint_sample, openxr_csv, webxr_json, words
from pose_samples import lerobot_bytes
from recording_samples import read_as

from hhsim.errors import TrajectoryError
from hhsim.recordings.joint_names import KEYPOINTS, StatedFields
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content, ReadOptions, read_content

SAMPLE, LEFT = joint_sample(), joint_sample("left")
TIME, COUNT = SAMPLE.motion.time, len(SAMPLE.motion.time)
NONE = {"poses": np.zeros(3)}


def read(data: bytes, **options: Any) -> Recording:
    return read_content(Content.of_recording(None, data), ReadOptions(world_up="y", **options))


@pytest.mark.parametrize(
    ("name", "value", "kind", "wanted"),
    [
        *((name, value, "side", ("right",)) for name in ("hand", "side", "Handedness", "meta/hand_side", "handSide")
          for value in ("right", "Right Hand", b"right", np.array(["R"]), ["rhand"] * 3, ["right", "", "right"])),
        *((name, value, "side", ("right",)) for name in ("is_right", "is_rhand", "isRight", "hands.is_right_hand")
          for value in (1, True, 1.0, "1", "true", np.array([1]), np.ones(5), [True, True])),
        *((name, value, "side", ("left",)) for name in ("is_right", "is_rhand")
          for value in (0, False, np.zeros((4, 1)))),
        *((name, value, "side", ("left",)) for name in ("is_left", "is_lhand") for value in (1, [1.0, np.nan])),
        ("hand", "l", "side", ("left",)),
        ("is_right", [1, 0, 1], "side", ("right", "left", "right")),
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
        ("scale", 0.01, "scale", 0.01),
        ("scale", "cm", "scale", 1e-2),
        ("unit", "furlong", "unit", None),
        ("scale", -1.0, "scale", None),
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
    with pytest.raises(TrajectoryError, match="named a left hand, but its fingers bend as a right one's"):
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


def test_rows_of_both_hands_are_parted_by_their_field() -> None:
    points = np.stack([POINTS, LEFT.named()], axis=1).reshape(-1, 21, 3)
    data = arrays_npz(keypoints=points, t=TIME.repeat(2), is_right=np.tile([1, 0], COUNT))
    for sample in (SAMPLE, LEFT):
        recording = read(data, hand=sample.motion.hand)
        assert_our_own(recording, sample)
        assert np.allclose(recording.time, TIME) and f"40 of 80 rows are of the {recording.hand} hand" in words(
            recording
        )
    assert "right hand; the left one is there too: --hand" in words(read(data))
    with pytest.raises(TrajectoryError, match="3 sides of a hand for 80 samples; expected one, or one a sample"):
        read(arrays_npz(keypoints=points, t=TIME.repeat(2), is_right=[1, 0, 1]))


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
    assert recording.object_motion is not None
    np.testing.assert_allclose(recording.object_motion.position, recording.position, atol=1e-12)
    by_turns = read_as("npz", arrays_npz(**arrays, t=TIME, is_right=np.arange(COUNT) % 2), hand="left")
    assert by_turns.rows.tolist() == list(range(0, COUNT, 2)) and by_turns.hand == "left"


def test_a_rate_beside_stamps_and_a_scale_that_makes_no_hand_are_not_used() -> None:
    told = words(read(arrays_npz(keypoints=POINTS, t=TIME, fps=30, scale=5.0)))
    assert "not used: fps, scale" in told and "taken for m;" in told
    scaled = read(arrays_npz(keypoints=POINTS / 3.0, t=TIME, scale=3.0))
    assert_our_own(scaled, SAMPLE)
    assert "positions in 3 m, as 'scale' says" in words(scaled)
    with pytest.raises(TrajectoryError, match=r"the hand is 0\.000183\d* m long .* say --length-unit"):
        read(arrays_npz(keypoints=POINTS, t=TIME, unit="mm"))


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
