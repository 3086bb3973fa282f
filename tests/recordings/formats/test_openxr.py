"""Tables with columns named after joints: our own hand's motion as OpenXR, Unity and MediaPipe would write it."""

import numpy as np
import pytest
from joint_samples import joint_sample, openxr_csv, words
from recording_samples import read_as

from hhsim.errors import HhsimError
from hhsim.recordings.cleaning import CleaningOptions, clean_recording
from hhsim.recordings.column_map import ColumnMap
from hhsim.recordings.joint_names import OPENXR_JOINTS
from hhsim.recordings.registry import Content, ReadOptions, format_of
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


def test_a_turned_hand_that_is_the_other_one_comes_back_as_the_other() -> None:
    sample = joint_sample("left")
    turned = read_as("openxr", openxr_csv(sample, "right"))
    assert "if it is the other hand, say --other-hand" in words(turned)
    other = clean_recording(turned, CleaningOptions(other_hand=True)).trajectory
    assert other.hand == "left"
    assert np.abs(other.flexion - sample.motion.flexion).max() < 1e-6


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
