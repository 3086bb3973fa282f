"""UmeTrack poses by the profile of our own hand."""

import json
from pathlib import Path

import numpy as np
import pytest
from joint_samples import joint_sample
from pose_samples import umetrack_lines, umetrack_profile

from hhsim.errors import InputError
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.registry import ReadOptions, read_recording


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
