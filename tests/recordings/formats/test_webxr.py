"""JSON of joints: our own hand's motion as WebXR pages and iwer would record it."""

import json

import numpy as np
from joint_samples import joint_sample, webxr_json, words
from recording_samples import read_as


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
