"""Leap Motion recordings, made from our own hand, packed in every way and damaged."""

import json

import numpy as np
import pytest
from joint_samples import words
from leap_document import document
from recording_samples import read_as

from hhsim.errors import TrajectoryError
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import clean_recording


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
