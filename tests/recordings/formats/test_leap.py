"""Leap Motion recordings, made from our own hand, packed in every way and damaged."""

import json
from typing import Literal

import numpy as np
import pytest
from joint_samples import words
from leap_document import CLEAN, document, packed
from lzstring import LZString
from recording_samples import read_as

from hhsim.errors import TrajectoryError
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.formats.leap import FORMAT, unpack
from hhsim.recordings.registry import Content, ReadOptions, read_content


@pytest.mark.parametrize("side", ["right", "left"])
def test_our_own_hand_comes_back(side: Literal["right", "left"]) -> None:
    recording = read_as("leap", json.dumps(document(side)), name="take")
    assert recording.hand == side and recording.sample_count == 30
    assert np.allclose(recording.time, CLEAN.time, atol=1e-6)
    assert np.allclose(recording.position, CLEAN.position, atol=1e-9)
    assert np.allclose(np.abs((recording.orientation * CLEAN.orientation).sum(axis=1)), 1.0)
    assert np.allclose(recording.flexion, CLEAN.flexion, atol=1e-6) and np.allclose(recording.abduction, 0.0, atol=1e-6)
    assert np.flatnonzero(marked(recording.flags, SampleFlag.INVALID)).tolist() == [4]
    assert recording.hand_length is not None and 0.17 < recording.hand_length < 0.2
    assert clean_recording(recording).trajectory.hand == side


def test_every_packing_holds_the_same_motion() -> None:
    whole = document()
    plain = read_as("leap", json.dumps(whole))
    texts = [
        json.dumps(packed(whole)),
        json.dumps(whole["frames"]),
        "\n".join(json.dumps(frame) for frame in [{"version": 6}, *whole["frames"]]),
        LZString.compressToBase64(json.dumps(packed(whole))),
    ]
    for text in texts:
        assert FORMAT.sniff(Content(data=text.encode()), ReadOptions())
        other = read_content(Content(data=text.encode(), name="take.json"), ReadOptions())
        assert other.flexion.tobytes() == plain.flexion.tobytes() and other.time.tobytes() == plain.time.tobytes()
        assert (other.form, other.name) == ("leap", "take")


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


def test_the_fingertip_stands_for_the_end_of_the_last_bone_where_there_is_none() -> None:
    whole = document()
    plain = read_as("leap", json.dumps(whole))
    for frame in whole["frames"]:
        for finger in frame["pointables"]:
            finger["tipPosition"] = finger.pop("btipPosition")
    early = read_as("leap", json.dumps(whole))
    assert early.flexion.tobytes() == plain.flexion.tobytes()
    for frame in whole["frames"]:
        for finger in frame["pointables"]:
            finger["btipPosition"], finger["tipPosition"] = finger["tipPosition"], [0.0, 0.0, 0.0]
    assert read_as("leap", json.dumps(whole)).flexion.tobytes() == plain.flexion.tobytes()


def without(key: str) -> str:
    whole = document(count=3)
    for frame in whole["frames"]:
        frame[key] = []
    return json.dumps(whole)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ('{"a": 1}\n{"a"', "line 2 is not JSON"),
        ('{"a": 1}', "JSON without frames, an object with a"),
        ('{"frames": [{"time": 0, "poses": [1.0]}]}', "a list of 1, the first an object with time, poses; expected"),
        ('{"frames": [3]}', "frame 1 is '3'; expected an object"),
        ('{"frames": [["id"], [1, 2]]}', "frame 1 holds 2 values; expected 1"),
        ('{"frames": [["id", {"hands": 3}], [1, 2]]}', "not packed as the first entry says"),
        (without("hands"), "no hand in any of 3 frames"),
        (without("pointables"), "no frame holds the joints"),
    ],
)
def test_what_is_no_recording_is_refused(text: str, said: str) -> None:
    with pytest.raises(TrajectoryError, match=said):
        read_as("leap", text)
    with pytest.raises(TrajectoryError, match="no left hand; the file has a right one"):
        read_as("leap", json.dumps(document(count=3)), hand="left")


@pytest.mark.parametrize("packed", ["w", "!!!!", "BYUw", "QAA="])
def test_what_is_no_packed_text_is_refused(packed: str) -> None:
    with pytest.raises(TrajectoryError, match="damaged LZ-string text"):
        unpack(packed)
