"""What single formats have of their own: mappings, what a file says of itself, orders, worlds, stamps, objects."""

import json
from pathlib import Path

import numpy as np
import pytest
from joint_samples import array_npy, arrays_npz, assert_our_own, joint_sample, openxr_csv, webxr_json, words
from leap_document import document
from pose_samples import lerobot_set, umetrack_lines, umetrack_profile
from recorded_files import CASES, COUNT, MOTION, OBJECT_CSV, angles_npz, laid_out
from recording_samples import read_as, smooth_recording

from hhsim.errors import HhsimError, InputError, TrajectoryError
from hhsim.hand.fingers import FINGERS
from hhsim.motion.csv_file import format_csv
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.formats.mano import read_mano_model
from hhsim.recordings.frames import turned, world_matrix
from hhsim.recordings.joint_names import KEYPOINTS, MANO_JOINTS, OPENXR_JOINTS, WEBXR_JOINTS
from hhsim.recordings.registry import Content, ReadOptions, format_of, read_recording
from hhsim.system.settings_file import parse_settings


def test_stamps_of_two_columns_are_one() -> None:
    columns = parse_settings("[time]\ncolumn = 'sec'\n[joint]\nindex_flex1 = 'a'", ColumnMap, "ros.toml")
    recording = read_as("csv", "sec,nanosec,a\n7,900000000,1\n8,0,2\n8,100000000,3\n", columns=columns)
    assert np.allclose(recording.time, [7.9, 8.0, 8.1]) and "not used" not in words(recording)


def test_euler_angles_turn_about_turned_or_fixed_axes() -> None:
    table = "t,a,b,c,f\n" + "".join(f"{0.01 * k},90,0,90,0\n" for k in range(3))
    for order, expected in (("ZYX", [0.0, 1.0, 0.0]), ("XYZ", [0.0, 0.0, 1.0]), ("zyx", [0.0, 0.0, 1.0])):
        text = f"columns = ['a', 'b', 'c']\norder = '{order}'\nunit = 'deg'\n[joint]\nindex_flex1 = 'f'"
        columns = parse_settings(f"[time]\ncolumn = 't'\n[orientation]\n{text}", ColumnMap, "map.toml")
        orientation = read_as("csv", table, columns=columns).orientation
        np.testing.assert_allclose(turned(orientation, np.eye(3)[0]), np.tile(expected, (3, 1)), atol=1e-15)


def test_our_own_csv_comes_in_bit_for_bit() -> None:
    motion = clean_recording(smooth_recording()).trajectory
    again = clean_recording(read_as("csv", format_csv(motion)))
    assert again.findings == ()
    assert format_csv(again.trajectory) == format_csv(motion)
    raised = read_as("csv", format_csv(motion), world_up="y")
    assert raised.name == motion.name and raised.hand == motion.hand
    np.testing.assert_allclose(raised.position, motion.position @ world_matrix("y").T)


@pytest.mark.parametrize(
    ("remark", "side"),
    [("hand: Left", "left"), ("hand: L", "left"), ("side: left", "left"), ("hand: none", ""), ("hand: both", "")],
)
def test_the_hand_of_our_own_csv_in_other_words(remark: str, side: str) -> None:
    text = format_csv(clean_recording(smooth_recording()).trajectory).replace("hand: right", remark)
    recording = read_as("csv", text)
    assert recording.hand == side and (f"{side or 'not used'}" in words(recording))
    assert read_as("csv", text, hand="left").hand == "left"


UNITLESS = """
hand = "right"
[time]
column = "Time"
[position]
columns = ["X", "Y", "Z"]
[joint]
index_flex1 = "MCP"
"""


@pytest.mark.parametrize(
    ("text", "stated"),
    [
        (UNITLESS, set()),
        (UNITLESS.replace('"Time"', '"Time"\nunit = "s"'), {"time"}),
        (UNITLESS.replace("[position]", "[angle]\nunit = 'rad'\n[position]"), {"angle"}),
        (UNITLESS.replace('"MCP"', "{ column = 'MCP', unit = 'rad' }"), {"angle"}),
        ("palm_offset = [0.0, 0.1, 0.0]\n" + UNITLESS.replace('"Z"]', '"Z"]\nunit = "m"'), {"length"}),
    ],
)
def test_a_unit_that_the_mapping_names_is_stated_and_another_is_found(text: str, stated: set[str]) -> None:
    columns = parse_settings(text, ColumnMap, "glove.toml")
    assert columns.stated == stated
    rows = "".join(f"{10 * k},0.2,0.1,0.0,{0.01 * k}\n" for k in range(100))
    table = f"Time,X,Y,Z,MCP\n{rows}"
    if "time" in stated:
        with pytest.raises(InputError, match="--time-unit ms: the file, or the mapping of its"):
            read_as("csv", table, columns=columns, time_unit="ms")
        with pytest.raises(TrajectoryError, match="in another unit"):
            read_as("csv", table, columns=columns)
    else:
        for unit in (None, "ms"):
            recording = read_as("csv", table, columns=columns, time_unit=unit)
            assert clean_recording(recording).trajectory.duration == pytest.approx(0.99)


@pytest.mark.parametrize("name", ["valid", "isActive", "is_tracked"])
def test_samples_that_are_not_valid_and_held_or_at_zero_are_missing(name: str) -> None:
    stated, rows = np.ones(COUNT), np.arange(COUNT)
    stated[[2, 5, 6, 9]] = 0.0
    rows[[5, 6]] = 4
    palm = {"wrist_pos": MOTION.position[rows] * (rows != 9)[:, None], "wrist_quat": MOTION.orientation[rows]}
    angles = {"flex": MOTION.flexion[rows], "abd": MOTION.abduction[rows]}
    recording = read_as("npz", angles_npz(**palm, **angles, **{name: stated}))
    assert np.flatnonzero(np.isnan(recording.position).all(axis=1)).tolist() == [5, 6, 9]
    assert np.flatnonzero(np.isnan(recording.abduction).all(axis=1)).tolist() == [5, 6, 9]
    assert np.flatnonzero(marked(recording.flags, SampleFlag.INVALID)).tolist() == [2, 5, 6, 9]


def test_every_real_recording_comes_in(shared_data: Path) -> None:
    files = sorted((shared_data / "recordings").glob("*.npz"))
    assert files
    for file in files:
        recording = read_recording(file)
        repaired = clean_recording(recording)
        motion, kinds = repaired.trajectory, {finding.kind for finding in repaired.findings}
        assert motion.sample_count == recording.sample_count and motion.name == file.stem
        assert kinds <= {"note", "gap_before", "suspect", "limited", "invalid", "fingers_filled"}, file.stem
        # The hand as it was: what a real device recorded is not taken for damage.
        assert motion.position.tobytes() == recording.position.tobytes()
        assert marked(motion.flags, SampleFlag.SUSPECT).mean() < 0.04, file.stem
        assert ("fingers_filled" in kinds) == file.stem.startswith("dfki")
        fingers, back = (turned(motion.orientation, axis).mean(axis=0) for axis in np.eye(3)[1:])
        if file.stem.startswith("leap") and not file.stem.endswith("wave"):
            assert fingers[1] > 0.6 and back[2] > 0.4, "over the device the fingers point forward, the back up"
        elif file.stem.endswith("wave"):
            assert fingers[2] > 0.8, "a waving hand points up"


SAMPLE = joint_sample()
POINTS, TIME = SAMPLE.named(), SAMPLE.motion.time
SEGMENTS_OF = {finger: [joint for joint in KEYPOINTS if joint.startswith(finger)] for finger in FINGERS}
NODES = [joint for joint in WEBXR_JOINTS if joint.startswith("thumb")]
FOREIGN: dict[str, list[str]] = {
    "InterHand": [*(joint for finger in FINGERS for joint in SEGMENTS_OF[finger][::-1]), "wrist"],
    "FrankMocap": [*MANO_JOINTS[:16], *(f"{finger}_tip" for finger in ("index", "middle", "little", "ring", "thumb"))],
    "FPHAB": [
        "wrist",
        *(SEGMENTS_OF[f][0] for f in FINGERS),
        *(joint for f in FINGERS for joint in SEGMENTS_OF[f][1:]),
    ],
    "tips first": ["wrist", *(joint for finger in FINGERS for joint in SEGMENTS_OF[finger][::-1])],
    "fingers reversed": ["wrist", *(joint for finger in FINGERS[::-1] for joint in SEGMENTS_OF[finger])],
    "level by level": ["wrist", *(SEGMENTS_OF[finger][k] for k in range(4) for finger in FINGERS)],
    "MANO": [*MANO_JOINTS],
    "MANUS": [*WEBXR_JOINTS[:1], *WEBXR_JOINTS[5:], *NODES],
}


@pytest.mark.parametrize("maker", FOREIGN)
@pytest.mark.parametrize("noise", [0.0, 0.004])
def test_rows_in_an_order_that_is_not_known_are_refused(maker: str, noise: float) -> None:
    rows = joint_sample(noise=noise).named(tuple(FOREIGN[maker]))
    for data in (array_npy(rows), array_npy(1e3 * rows), json.dumps(rows.tolist()).encode()):
        with pytest.raises(TrajectoryError, match=r"in the order .*: .* times a hand's, .*; say") as error:
            read_as("keypoints", data, rate=100.0, hand="right")
        assert "--mirror" not in str(error.value) and "\n" not in str(error.value)


def test_a_stated_order_is_taken_where_bones_are_those_of_a_hand() -> None:
    line = np.zeros((40, 21, 3))
    line[:, 1:, 0] = 0.1
    line[:, :, 1] = np.sin(TIME)[:, None]
    with pytest.raises(TrajectoryError, match="not in the order mediapipe, by their bones"):
        read_as("keypoints", arrays_npz(points=line, t=TIME))
    foreign = array_npy(SAMPLE.named(tuple(FOREIGN["FPHAB"])))
    for side in ("right", "left", ""):
        try:
            text = words(read_as("keypoints", foreign, rate=100.0, joint_order="mano", hand=side))
        except TrajectoryError as error:
            text = str(error)
        assert "bones are not those of a hand" in text and "--mirror" not in text
    told = read_as("keypoints", array_npy(SAMPLE.named(MANO_JOINTS)), rate=100.0, world_up="y", joint_order="smplx")
    assert_our_own(told, SAMPLE)
    assert "in the order smplx" in words(told)


def test_each_hand_of_two_arrays_is_read_by_its_side() -> None:
    data = arrays_npz(right_joints=POINTS, left_joints=POINTS * [-1.0, 1.0, 1.0])
    for side in ("right", "left"):
        assert read_as("keypoints", data, hand=side, rate=30.0).hand == side


def test_of_two_models_each_hand_takes_its_own(tmp_path: Path) -> None:
    path, options = laid_out(CASES["mano, lines, left"], tmp_path)
    assert "model model_left.npz" in words(read_recording(path, options))
    content = Content(path)
    mano = format_of(content, options).mano
    model, *parameters = mano(content, options)
    assert np.array_equal(model.template, read_mano_model(tmp_path / "MODEL_LEFT.npz").template)
    assert model.keypoints(*parameters).shape == (COUNT, 21, 3)
    (tmp_path / "MODEL_LEFT.npz").unlink()
    with pytest.raises(InputError, match=r"left hand, but the model is called .*: is it the other hand's\?"):
        read_recording(path, options)


def test_an_open_hand_whose_thumb_is_level_with_it_is_taken_for_right_handed_with_a_word() -> None:
    sample = joint_sample(bend=0.0)
    names = ["wrist", "index_proximal", "little_proximal"]
    wrist, index, little = (sample.joints[:, OPENXR_JOINTS.index(name)] for name in names)
    joints = sample.joints.copy()
    for k, name in enumerate(("proximal", "distal", "tip")):
        aside = index + 0.5 * (index - little) - wrist
        joints[:, OPENXR_JOINTS.index(f"thumb_{name}")] = wrist + (0.5 + 0.2 * k) * aside
    text = openxr_csv(sample._replace(joints=joints), unity=True)
    told = words(read_as("openxr", text))
    assert "to tell whether its coordinates are left-handed, as Unity's: taken for right-handed" in told


@pytest.mark.parametrize("named", ["right_", ""])
def test_the_users_word_for_the_hand_turns_a_left_handed_world_as_the_files_own_does(named: str) -> None:
    text = openxr_csv(joint_sample(), unity=True).replace("right_", named)
    recording = read_as("openxr", text, hand="right")
    assert "left-handed, as Unity's" in words(recording)
    assert np.abs(recording.flexion - joint_sample().motion.flexion).max() < 1e-6


def test_stamps_of_two_clocks_and_samples_that_are_not_valid() -> None:
    lines = openxr_csv(joint_sample()).splitlines()
    head = f"host_time_s,device_time_ns,right_wrist_valid,{lines[0].split(',', 2)[2]}"
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
    (folder / "dynamic_objects.csv").write_text("\n".join([OBJECT_CSV, *rows]) + "\n")


def test_the_object_beside_the_hand_is_taken_where_it_is_the_one_or_named(folder: Path) -> None:
    path = folder / "poses.jsonl"
    path.write_text(umetrack_lines(joint_sample()))
    objects(folder, "17")
    moved = read_recording(path).object_motion
    assert np.isnan(moved.position[3]).all()
    # The file's y points up.
    np.testing.assert_allclose(moved.position[[0, 8]], [[0.1, -0.3, 0.0], [0.1, -0.3, joint_sample().motion.time[8]]])
    made = clean_recording(read_recording(path)).trajectory
    assert np.isfinite(made.object_motion.position).all()
    objects(folder, "17", "23")
    none = read_recording(path)
    assert none.object_motion is None
    assert "poses of the objects 17, 23; expected one of them as --object-track" in words(none)
    named = read_recording(path, ReadOptions(object_track="17")).object_motion
    assert named.position[8].tobytes() == moved.position[8].tobytes()
    with pytest.raises(InputError, match="poses of the objects 17, 23; expected one of them as --object-track"):
        read_recording(path, ReadOptions(object_track="18"))
