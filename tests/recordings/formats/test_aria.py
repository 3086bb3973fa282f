"""Aria's hand_tracking_results.csv: our own hand by its landmarks."""

import csv
import io
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from joint_samples import joint_sample
from recording_samples import read_as

from hhsim.errors import TrajectoryError
from hhsim.recordings.formats.aria import landmark_columns
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS
from hhsim.recordings.registry import ReadOptions, read_recording

SAMPLE = joint_sample()
PLACES = SAMPLE.named(OPENXR_JOINTS)
LOST = 5
"""Frame without a hand."""


def aria(change: Callable[[str], str] = lambda text: text) -> bytes:
    """Our sample as Aria's right hand; of the left one there is none in any frame."""
    rows = []
    for t, points in enumerate(PLACES):
        row: dict[str, object] = {"tracking_timestamp_us": 37_709_493_155 + 100_000 * t}
        for side in ("left", "right"):
            seen = side == "right" and t != LOST
            row[f"{side}_tracking_confidence"] = 0.99 if seen else -1
            for joint, columns in landmark_columns(side).items():
                row |= dict(zip(columns, points[OPENXR_JOINTS.index(joint)].tolist() if seen else (0, 0, 0)))
        rows.append(row)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return change(text.getvalue()).encode()


def test_landmarks_are_our_own_hand(tmp_path: Path) -> None:
    path = tmp_path / "hand_tracking_results.csv"
    path.write_bytes(aria())
    recording = read_recording(path, ReadOptions(usual_up="y"))
    assert (recording.form, recording.hand, recording.joints is None) == ("aria", "right", False)
    assert recording.joints is not None
    np.testing.assert_allclose(np.diff(recording.time), 0.1)
    assert np.flatnonzero(np.isnan(recording.joints).any(axis=(1, 2))).tolist() == [LOST]
    file = recording.file_frame.to_file(recording.joints)
    known = [k for k in range(len(PLACES)) if k != LOST]
    for k, joint in enumerate(KEYPOINTS):
        off = np.linalg.norm(file[known, k] - PLACES[known, OPENXR_JOINTS.index(joint)], axis=1).max()
        assert off < (0.012 if joint == "thumb_metacarpal" else 1e-12), joint
    with pytest.raises(TrajectoryError, match="no sample"):
        read_recording(path, ReadOptions(hand="left"))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda text: text.replace("right_landmark_20", "right_landmark_21"), "no column tx_right_landmark_20_device"),
        (lambda text: text.replace("right_tracking_confidence", "sure"), "no column right_tracking_confidence"),
    ],
)
def test_a_column_that_is_missing_is_told(change: Callable[[str], str], said: str) -> None:
    with pytest.raises(TrajectoryError, match=said):
        read_as("aria", aria(change))
