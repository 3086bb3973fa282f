"""Recordings in NumPy archives."""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_samples import read_as, smooth_recording

from hhsim.hand.quaternion import rotation_matrix
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.frames import turned, world_matrix
from hhsim.recordings.registry import read_recording

CLEAN = smooth_recording(50)


def archive(**changes: Any) -> bytes:
    arrays: dict[str, Any] = {
        "t": CLEAN.time,
        "wrist_pos": CLEAN.position,
        "wrist_quat": CLEAN.orientation,
        "flex": CLEAN.flexion,
        "abd": CLEAN.abduction,
    }
    arrays = {key: value for key, value in (arrays | changes).items() if value is not None}
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def test_what_the_file_says_of_itself() -> None:
    valid = np.ones(50, dtype=bool)
    valid[7:9] = False
    meta = json.dumps(
        {"source": "a lab", "hand": "left one", "frame": "palm: x=direction, z=-palmNormal; y up", "note": "!"}
    )
    recording = read_as("npz", archive(valid=valid, meta=np.array(meta)))
    assert (recording.hand, recording.source) == ("left", "a lab")
    assert np.flatnonzero(marked(recording.flags, SampleFlag.INVALID)).tolist() == [7, 8]
    assert "palm axes x, y, z are the recording's -y, x, z; its world's y points up" in recording.findings[0].text
    palm, theirs = rotation_matrix(recording.orientation[3]), rotation_matrix(CLEAN.orientation[3])
    up = world_matrix("y")
    assert np.allclose(palm[:, 1], up @ theirs[:, 0]), "their x points to the fingers"
    assert np.allclose(palm[:, 2], up @ theirs[:, 2]), "their z points out of the back"
    assert np.allclose(recording.position, CLEAN.position @ up.T)
    as_ours = read_as("npz", archive(meta=np.array(meta)), palm_axes=("x", "y", "z"), world_up="z")
    assert np.allclose(as_ours.orientation, CLEAN.orientation)
    assert read_as("npz", archive(meta=np.array("no json"))).source == ""


@pytest.mark.parametrize("name", ["valid", "isActive", "is_tracked"])
def test_samples_that_are_not_valid_and_held_or_at_zero_are_missing(name: str) -> None:
    stated, rows = np.ones(50), np.arange(50)
    stated[[7, 20, 21, 40]] = 0.0
    rows[[20, 21]] = 19
    place = CLEAN.position[rows] * (rows != 40)[:, None]
    given = {"wrist_quat": CLEAN.orientation[rows], "flex": CLEAN.flexion[rows], "abd": CLEAN.abduction[rows]}
    recording = read_as("npz", archive(wrist_pos=place, **given, **{name: stated}))
    assert np.flatnonzero(np.isnan(recording.position).all(axis=1)).tolist() == [20, 21, 40]
    assert np.flatnonzero(np.isnan(recording.abduction).all(axis=1)).tolist() == [20, 21, 40]
    assert np.flatnonzero(marked(recording.flags, SampleFlag.INVALID)).tolist() == [7, 20, 21, 40]


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
        assert motion.flags is not None
        assert marked(motion.flags, SampleFlag.SUSPECT).mean() < 0.04, file.stem
        assert ("fingers_filled" in kinds) == file.stem.startswith("dfki")
        fingers, back = (turned(motion.orientation, axis).mean(axis=0) for axis in np.eye(3)[1:])
        if file.stem.startswith("leap") and not file.stem.endswith("wave"):
            assert fingers[1] > 0.6 and back[2] > 0.4, "over the device the fingers point forward, the back up"
        elif file.stem.endswith("wave"):
            assert fingers[2] > 0.8, "a waving hand points up"
