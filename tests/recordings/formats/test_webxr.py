"""JSON of joints: our own hand's motion as WebXR pages and iwer would record it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_samples import Side, assert_our_own, iwer_json, joint_sample, webxr_json, words
from recording_samples import read_as

from hhsim.errors import TrajectoryError
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.joint_names import WEBXR_JOINTS
from hhsim.recordings.registry import Content, ReadOptions, read_content, read_recording


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("write", [webxr_json, iwer_json])
def test_our_own_hand_comes_back(side: Side, write: Any) -> None:
    sample = joint_sample(side)
    recording = read_content(Content(data=write(sample, side).encode(), name="take"), ReadOptions())
    assert (recording.form, recording.hand) == ("webxr", side)
    motion = clean_recording(recording).trajectory
    assert np.allclose(motion.time, sample.motion.time, atol=1e-6)
    assert_our_own(recording, sample)
    assert recording.bones is not None and recording.bones.radius is not None
    assert np.allclose(recording.bones.radius, sample.hand.radius)
    assert "25 WebXR joints" in words(recording) and "world y up" in words(recording)


def test_joints_that_unity_wrote_are_turned_to_a_right_handed_world() -> None:
    recording = read_as("webxr", webxr_json(joint_sample("left"), "left", unity=True))
    assert "left-handed, as Unity's" in words(recording)
    assert_our_own(recording, joint_sample("left"))


def shapes(sample_frames: list[dict[str, Any]]) -> dict[str, Any]:
    """The same frames as other pages write them."""
    stamps = [frame["timeStamp"] for frame in sample_frames]
    hands = [list(frame["hands"]["right"].values()) for frame in sample_frames]
    points = [[list(joint["position"].values()) for joint in hand] for hand in hands]
    names = WEBXR_JOINTS
    return {
        "a line a frame": [{"time_ms": t, "handedness": "right", "joints": hand} for t, hand in zip(stamps, hands)],
        "named in a list": [
            {
                "t": 1e-3 * t,
                "side": "Right",
                "joints": [{"name": n, "pose": {"position": p}} for n, p in zip(names, hand)],
            }
            for t, hand in zip(stamps, points)
        ],
        "points by name": {
            "hand": "right",
            "data": [{"time": t, "joints": dict(zip(names, hand))} for t, hand in zip(stamps, points)],
        },
    }


@pytest.mark.parametrize("shape", ["a line a frame", "named in a list", "points by name"])
def test_frames_of_other_shapes(shape: str) -> None:
    sample = joint_sample()
    document = shapes(json.loads(webxr_json(sample))["frames"])[shape]
    text = "\n".join(map(json.dumps, document)) if shape == "a line a frame" else json.dumps(document)
    motion = clean_recording(read_as("webxr", text)).trajectory
    assert motion.hand == "right" and np.allclose(motion.time - motion.time[0], sample.motion.time, atol=1e-6)
    assert np.abs(motion.flexion - sample.motion.flexion).max() < 1e-6


def matrices(points: Any) -> list[list[float]]:
    """Matrices of joints with these centres, column by column."""
    return [[0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, *point, 1.0] for point in points.tolist()]


MATRICES: dict[str, Callable[[list[list[float]]], Any]] = {
    "by name": lambda flat: {"right": dict(zip(WEBXR_JOINTS, flat))},
    "row by row": lambda flat: {"right": [np.reshape(each, (4, 4)).T.ravel().tolist() for each in flat]},
    "four rows": lambda flat: {"right": [np.reshape(each, (4, 4)).T.tolist() for each in flat]},
    "of a transform": lambda flat: {"right": [{"transform": {"matrix": each}, "radius": 0.01} for each in flat]},
    "of all joints in a row": lambda flat: {"handedness": "right", "poses": [x for each in flat for x in each]},
    "of a typed array": lambda flat: {
        "handedness": "right", "poses": {str(k): x for k, x in enumerate(x for each in flat for x in each)}
    },
}  # fmt: skip


@pytest.mark.parametrize("shape", MATRICES)
def test_joints_as_matrices(shape: str, tmp_path: Path) -> None:
    sample = joint_sample()
    points = sample.named(WEBXR_JOINTS)
    frames = [
        {"time": float(stamp), "hands": MATRICES[shape](matrices(each))}
        for stamp, each in zip(sample.motion.time, points)
    ]
    file = tmp_path / "take.json"
    file.write_text(json.dumps({"frames": frames}))
    recording = read_recording(file)
    assert (recording.form, recording.hand) == ("webxr", "right") and "world y up" in words(recording)
    assert_our_own(recording, sample)


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


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (('"timeStamp"', '"number"'), "25 WebXR joints of the right hand named, but no stamps"),
        (("ring-finger-tip", "ring-finger-nail"), "named, but none that is ring_tip; expected"),
    ],
)
def test_a_refusal_says_what_was_recognised(change: tuple[str, str], said: str) -> None:
    with pytest.raises(TrajectoryError, match=said):
        read_as("webxr", webxr_json(joint_sample()).replace(*change))
    for other, reason in (('{"a": 1}', "no frames in JSON that is an object with a"), ('[{"t": 1}]', "no hand in any")):
        with pytest.raises(TrajectoryError, match=reason):
            read_as("webxr", other)
    with pytest.raises(TrajectoryError, match="no left hand; the file has a right one"):
        read_as("webxr", webxr_json(joint_sample()), hand="left")
