"""UmeTrack poses by the profile of our own hand."""

import json
from pathlib import Path

import numpy as np
import pytest
from joint_samples import Side, assert_our_own, joint_sample, words
from pose_samples import umetrack_lines, umetrack_profile

from hhsim.errors import InputError, TrajectoryError
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.registry import ReadOptions, read_recording


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "umetrack_hand_user_profile.json").write_text(umetrack_profile())
    return tmp_path


@pytest.mark.parametrize("side", ["right", "left"])
def test_our_own_hand_comes_back(side: Side, folder: Path) -> None:
    sample = joint_sample(side)
    (folder / "poses.jsonl").write_text(umetrack_lines(sample))
    recording = read_recording(folder / "poses.jsonl")
    assert (recording.form, recording.hand) == ("umetrack", side)
    assert np.allclose(recording.time, sample.motion.time, atol=1e-6)
    assert_our_own(recording, sample)
    assert recording.bones is not None and recording.bones.largest.max() < 1e-9
    assert "y, as on Quest; on Aria it is z: --world-up" in words(recording)
    named = read_recording(folder / "poses.jsonl", ReadOptions(profile=folder / "umetrack_hand_user_profile.json"))
    assert named.flexion.tobytes() == recording.flexion.tobytes()


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


def test_two_cameras_of_one_moment_are_one_sample(folder: Path) -> None:
    lines = umetrack_lines(joint_sample()).splitlines()
    twice = [each for line in lines for each in (line, _shifted(line, 91_000))]
    (folder / "poses.jsonl").write_text("\n".join(twice) + "\n")
    recording = read_recording(folder / "poses.jsonl")
    assert recording.sample_count == 40 and "40 of 80 poses" in words(recording)


def _shifted(line: str, nanoseconds: int) -> str:
    document = json.loads(line)
    return json.dumps(document | {"timestamp_ns": document["timestamp_ns"] + nanoseconds})


@pytest.mark.parametrize(
    ("profile", "said"),
    [
        (None, "need the profile of the hand, and there is none beside it: say --profile"),
        ("{", "not JSON"),
        ("[]", "an empty list; expected the profile"),
        ('{"hand_model": {}}', "joint_rest_positions is not at least 20 points"),
        (umetrack_profile().replace("joint_rotation_axes", "axes"), "joint_rotation_axes is not at least 20 points"),
    ],
)
def test_a_profile_that_is_none_is_refused(profile: str | None, said: str, tmp_path: Path) -> None:
    (tmp_path / "poses.jsonl").write_text(umetrack_lines(joint_sample()))
    if profile is not None:
        (tmp_path / "my_user_profile.json").write_text(profile)
    with pytest.raises(TrajectoryError, match=said):
        read_recording(tmp_path / "poses.jsonl")
