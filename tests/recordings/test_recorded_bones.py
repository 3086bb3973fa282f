"""Bones of a recording: a joint that stands elsewhere in some samples is told, in any format of joint centres."""

from pathlib import Path

import numpy as np
from joint_samples import array_npy, joint_sample

from hhsim.recordings.finger_ik import BONE_CHANGE, misplaced_joints
from hhsim.recordings.registry import ReadOptions, read_recording

OPTIONS = ReadOptions(rate=100.0, world_up="y", hand="right")


def test_the_bones_of_a_rigid_hand_are_no_finding() -> None:
    points = joint_sample().named()
    assert misplaced_joints(points[:, 1:].reshape(-1, 5, 4, 3), points[:, 0]) == []


def test_a_misplaced_joint_is_told_with_its_sample_and_distance(tmp_path: Path) -> None:
    points = joint_sample().named().copy()
    bone = points[7, 6] - points[7, 5]
    # Along the bone, so that its length changes by as much.
    points[7, 6:9] += 3.0 * BONE_CHANGE * bone / np.linalg.norm(bone)
    path = tmp_path / "take.npy"
    path.write_bytes(array_npy(points))
    told = [finding.text for finding in read_recording(path, OPTIONS).findings if "misplaced" in finding.text]
    assert len(told) == 1 and "1 of 40 samples" in told[0] and "first sample 7" in told[0] and "30 mm" in told[0]


def test_a_signalling_nan_of_float32_is_missing_without_a_warning(tmp_path: Path) -> None:
    points = joint_sample().named().astype(np.float32)
    points.view(np.uint32)[3, 4, 1] = 0x7F800001
    path = tmp_path / "take.npy"
    path.write_bytes(array_npy(points))
    with np.errstate(invalid="raise"):
        recording = read_recording(path, OPTIONS)
    assert np.isnan(recording.flexion[3]).any() and np.isfinite(recording.flexion[4]).all()
