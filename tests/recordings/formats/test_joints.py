"""What single formats of joints have of their own: sides and worlds, stamps, frames without a hand, objects beside."""

import json
from pathlib import Path

import numpy as np
import pytest
from joint_samples import joint_sample, openxr_csv, webxr_json, words
from leap_document import document
from pose_samples import lerobot_set, umetrack_lines, umetrack_profile
from recording_samples import read_as

from hhsim.errors import HhsimError, InputError, TrajectoryError
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.joint_names import OPENXR_JOINTS
from hhsim.recordings.registry import Content, ReadOptions, format_of, read_recording
from hhsim.system.settings_file import parse_settings


def test_an_open_hand_whose_thumb_is_level_with_it_is_taken_for_right_handed_with_a_word() -> None:
    sample = joint_sample(bend=0.0)
    names = ["wrist", "index_proximal", "little_proximal"]
    wrist, index, little = (sample.joints[:, OPENXR_JOINTS.index(name)] for name in names)
    joints = sample.joints.copy()
    for k, name in enumerate(("proximal", "distal", "tip")):
        joints[:, OPENXR_JOINTS.index(f"thumb_{name}")] = wrist + (0.5 + 0.2 * k) * (
            index + 0.5 * (index - little) - wrist
        )
    text = openxr_csv(sample._replace(joints=joints), unity=True)
    assert "to tell whether its coordinates are left-handed, as Unity's: taken for right-handed" in words(
        read_as("openxr", text)
    )


@pytest.mark.parametrize("named", ["right_", ""])
def test_the_users_word_for_the_hand_turns_a_left_handed_world_as_the_files_own_does(named: str) -> None:
    text = openxr_csv(joint_sample(), unity=True).replace("right_", named)
    recording = read_as("openxr", text, hand="right")
    assert "left-handed, as Unity's" in words(recording)
    assert np.abs(recording.flexion - joint_sample().motion.flexion).max() < 1e-6


def test_stamps_of_ros_in_two_columns() -> None:
    sample = joint_sample()
    lines = openxr_csv(sample).splitlines()
    stamps = [1_700_000_000_950_000_000 + round(1e9 * float(stamp)) for stamp in sample.motion.time]
    heads = ["header.stamp.sec,header.stamp.nanosec", *(f"{stamp // 10**9},{stamp % 10**9}" for stamp in stamps)]
    table = "\n".join(f"{head},{line.split(',', 2)[2]}" for head, line in zip(heads, lines)) + "\n"
    recording = read_as("openxr", table)
    assert np.abs(recording.time - sample.motion.time).max() < 1e-6
    assert "header" not in words(recording)


def test_stamps_of_two_clocks_and_samples_that_are_not_valid() -> None:
    lines = openxr_csv(joint_sample()).splitlines()
    head = f"host_time_s,device_time_ns,right_valid,{lines[0].split(',', 2)[2]}".replace(
        "right_valid", "right_wrist_valid"
    )
    rows = [
        f"{0.02 + 1e-3 * float(stamp) + 0.003 * (k % 2)!r},{round(1e6 * float(stamp))},{int(k != 3)},{rest}"
        for k, (_, stamp, rest) in enumerate(row.split(",", 2) for row in lines[1:])
    ]
    recording = read_as("openxr", "\n".join([head, *rows]) + "\n")
    assert "stamps from column 'device_time_ns'; there are also host_time_s" in words(recording)
    assert np.allclose(recording.time, joint_sample().motion.time, atol=1e-8)
    assert np.flatnonzero(recording.flags).tolist() == [3]


def test_a_rate_stands_in_for_stamps_and_a_mapping_goes_before() -> None:
    text = openxr_csv(joint_sample()).replace("timestamp_ms", "number")
    assert read_as("openxr", text, rate=50.0).time[-1] == pytest.approx(39 / 50)
    columns = parse_settings("rate = 100\n[joint]\nindex_flex1 = 'frame'", ColumnMap, "map.toml")
    assert format_of(Content(data=text.encode()), ReadOptions(columns=columns)).name == "csv"
    with pytest.raises(HhsimError, match="no columns named after the joints"):
        read_as("openxr", "a,b\n1,2\n")


def test_stamps_of_messages_of_ros() -> None:
    sample = joint_sample()
    frames = json.loads(webxr_json(sample))["frames"]
    for frame in frames:
        stamp = 1_700_000_000_950_000_000 + round(1e6 * frame.pop("timeStamp"))
        frame["header"] = {"frame_id": "map", "stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}}
    recording = read_as("webxr", json.dumps(frames))
    assert np.abs(recording.time - sample.motion.time).max() < 1e-6
    assert "header" not in words(recording)


def test_frames_without_the_hand_are_no_samples_and_are_counted() -> None:
    whole = json.loads(webxr_json(joint_sample()))
    for frame in whole["frames"][5:9]:
        frame["hands"] = {}
    del whole["frames"][12]["hands"]["right"]["index-finger-tip"]
    recording = read_as("webxr", json.dumps(whole))
    assert recording.sample_count == 36 and "4 of 40 frames show no such hand" in words(recording)
    assert np.argwhere(np.isnan(recording.abduction)).tolist() == [[8, 1]]


def test_frames_without_the_hand_are_no_samples() -> None:
    whole = document()
    for frame in whole["frames"][10:15]:
        frame["hands"] = []
    whole["frames"][20]["hands"].append(whole["frames"][20]["hands"][0] | {"type": "left", "id": 8})
    recording = read_as("leap", json.dumps(whole))
    assert recording.sample_count == 25 and "5 of 30 frames show no such hand" in words(recording)
    repaired = clean_recording(recording)
    assert repaired.trajectory.flags is not None
    assert np.flatnonzero(marked(repaired.trajectory.flags, SampleFlag.GAP_BEFORE)).tolist() == [10]
    with pytest.raises(TrajectoryError, match="no frame holds the joints"):
        read_as("leap", json.dumps(whole), hand="left")
    whole["frames"] = whole["frames"][:-3]
    assert "27 frames where the file says 30" in words(read_as("leap", json.dumps(whole)))


def test_joints_that_are_missing_are_holes() -> None:
    whole = document()
    del whole["frames"][7]["pointables"][1]["pipPosition"]
    whole["frames"][8]["pointables"][2]["btipPosition"] = [1, "x", None]
    recording = read_as("leap", json.dumps(whole))
    assert np.argwhere(np.isnan(recording.abduction)).tolist() == [[7, 1], [8, 2]]
    repaired = clean_recording(recording)
    assert repaired.trajectory.flags is not None
    assert np.flatnonzero(marked(repaired.trajectory.flags, SampleFlag.FINGERS_FILLED)).tolist() == [7, 8]


ANGLES = """
hand = "right"
[time]
column = "timestamp"
[angle]
unit = "deg"
[joint]
index_flex1 = "observation.state.index_mcp"
index_flex2 = "observation.state.index_pip"
"""


def test_angles_come_by_the_names_of_the_data_set(tmp_path: Path) -> None:
    path = lerobot_set(tmp_path)
    columns = parse_settings(ANGLES, ColumnMap, "map.toml")
    recording = read_recording(path, ReadOptions(columns=columns))
    assert np.allclose(recording.flexion[:, 1, :2], joint_sample().motion.flexion[:, 1, :2])
    assert recording.form == "lerobot" and read_recording(path).device == "glove"
    # Without the data set around it a column has a number for a name.
    numbered = parse_settings(ANGLES.replace("index_mcp", "0").replace("index_pip", "1"), ColumnMap, "map.toml")
    assert np.allclose(read_as("lerobot", path.read_bytes(), columns=numbered).flexion, recording.flexion)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "umetrack_hand_user_profile.json").write_text(umetrack_profile())
    return tmp_path


TABLE = "object_uid,timestamp[ns],t_wo_x[m],t_wo_y[m],t_wo_z[m],q_wo_w,q_wo_x,q_wo_y,q_wo_z\n"


def objects(folder: Path, *uids: str) -> None:
    """A table of objects, each at the moments of the poses but the fourth; the first goes up by a metre a second."""
    lines = (folder / "poses.jsonl").read_text().splitlines()
    stamps = [json.loads(line)["timestamp_ns"] for line in lines]
    rows = [
        f"{uid},{stamp},0.1,{1e-9 * (stamp - stamps[0]) if uid == uids[0] else 0.0},0.3,1,0,0,0"
        for k, stamp in enumerate(stamps)
        for uid in uids
        if k != 3
    ]
    (folder / "dynamic_objects.csv").write_text(TABLE + "\n".join(rows) + "\n")


def test_the_object_beside_the_hand_is_taken_where_it_is_the_one_or_named(folder: Path) -> None:
    path = folder / "poses.jsonl"
    path.write_text(umetrack_lines(joint_sample()))
    objects(folder, "17")
    moved = read_recording(path).object_motion
    assert moved is not None and np.isnan(moved.position[3]).all()
    # The file's y points up.
    np.testing.assert_allclose(moved.position[[0, 8]], [[0.1, -0.3, 0.0], [0.1, -0.3, joint_sample().motion.time[8]]])
    made = clean_recording(read_recording(path)).trajectory
    assert made.object_motion is not None and np.isfinite(made.object_motion.position).all()
    objects(folder, "17", "23")
    none = read_recording(path)
    assert none.object_motion is None
    assert any("holds 2 objects: --object-track takes one of 17 (" in finding.text for finding in none.findings)
    named = read_recording(path, ReadOptions(object_track="17")).object_motion
    assert named is not None and named.position[8].tobytes() == moved.position[8].tobytes()
    with pytest.raises(InputError, match=r"--object-track 18: dynamic_objects\.csv beside the recording holds 17"):
        read_recording(path, ReadOptions(object_track="18"))
