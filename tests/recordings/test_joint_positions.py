"""From joint centres to a recording: held against our own forward kinematics, and against noise of known size."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joint_samples import JointSample, array_npy, joint_sample, words

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import clean_recording
from hhsim.recordings.joint_names import KEYPOINTS
from hhsim.recordings.joint_positions import JointPositions, recording_of_joints
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content, ReadOptions, read_recording


def read(sample: JointSample, options: ReadOptions | None = None, **fields: Any) -> Recording:
    given: dict[str, Any] = {
        "time": sample.motion.time,
        "position": sample.named(),
        "up": "y",
        "unit": 1.0,
        "time_unit": "s",
    }
    return recording_of_joints(
        JointPositions(**given | fields), Content(data=b"", name="take"), options or ReadOptions()
    )


@pytest.mark.parametrize("noise", [0.0005, 0.002])
def test_the_error_of_the_fit_is_that_of_the_noise(noise: float) -> None:
    recording = read(joint_sample(count=400, noise=noise))
    assert recording.bones is not None
    # Four points of three coordinates a finger, of which four angles are fitted and the palm takes its share.
    free = recording.bones.rms / noise
    assert (free > np.sqrt(3.0 * (12 - 4 - 6) / 12)).all() and (free < 1.6 * np.sqrt(3.0)).all()
    assert (recording.bones.largest > recording.bones.rms).all()


def test_lengths_are_found_stated_or_scaled() -> None:
    sample = joint_sample()
    exact = read(sample).flexion
    for factor, unit in ((1.0, "m"), (100.0, "cm"), (1000.0, "mm"), (1.0 / 0.0254, "inch")):
        recording = read(sample, position=factor * sample.named(), unit=None)
        assert f"taken for {unit};" in words(recording) and np.allclose(recording.flexion, exact)
        assert recording.bones is not None and recording.bones.hand_length == pytest.approx(0.1835, abs=1e-3)
    stated = read(sample, ReadOptions(length_unit="mm"), position=1e3 * sample.named(), unit=None)
    assert "unit" not in words(stated)
    with pytest.raises(TrajectoryError, match=r"the hand is 183\.\d m long .* say --length-unit"):
        read(sample, position=1e3 * sample.named())
    image = read(sample, ReadOptions(hand_length=0.18), position=3.0 * sample.named(), unit=None)
    assert "no scale" in words(image) and "180 mm (as --hand-length says)" in words(image)
    assert image.hand_length == pytest.approx(0.18) and np.allclose(image.flexion, exact)


def test_the_side_is_said_or_told_by_the_fingers_or_asked_for() -> None:
    for side in ("right", "left"):
        told = read(joint_sample(side))
        assert told.hand == side and f"a {side} one by the bend of its fingers" in words(told)
    for fields, other in (({}, "--hand right"), ({"hand": "left"}, "--mirror x --other-hand")):
        with pytest.raises(TrajectoryError, match=rf"named a left hand, .* as a right one's: .*, {other} if it is"):
            read(joint_sample("right"), ReadOptions(hand="" if fields else "left"), **fields)
    wrong = read(joint_sample("right", bend=0.1), hand="left")
    assert wrong.hand == "left" and "as a left hand its thumb is behind its palm" in words(wrong)
    assert "thumb" not in words(read(joint_sample("right", bend=0.1), hand="right"))
    with pytest.raises(TrajectoryError, match="too straight to tell: say --hand"):
        read(joint_sample(), time=np.arange(9.0), position=still(np.zeros((5, 3))))
    # Fingers bent backwards, the thumb before the palm all the same: it may be the hand that it is called.
    backwards = still(np.array([[0.7] * 3, *[[-0.2] * 3] * 4]))
    told = read(joint_sample(), time=np.arange(9.0), position=backwards, hand="right")
    assert told.hand == "right" and "as a right hand its fingers bend backwards by 11°" in words(told)


def still(flexion: FloatArray) -> FloatArray:
    fingers = joint_sample().hand.joints(np.zeros(3), np.eye(4)[0], flexion, np.zeros(5)).reshape(20, 3)
    return np.tile(np.concatenate([[[-0.006, -0.042, 0.0]], fingers]), (9, 1, 1))


def test_missing_joints_are_holes_and_doubtful_samples_are_marked() -> None:
    sample = joint_sample()
    points = sample.named()
    points[7, KEYPOINTS.index("index_tip")] = np.nan
    points[9] = 0.0
    points[11, 3, 1] = np.inf
    said = np.where(np.arange(40)[:, None] == 20, 0.3, 1.0)
    recording = read(sample, position=points, validity={"confidence": said})
    assert np.argwhere(np.isnan(recording.abduction)).tolist() == [[7, 1], *([9, f] for f in range(5)), [11, 0]]
    assert np.flatnonzero(marked(recording.flags, SampleFlag.INVALID)).tolist() == [20]
    assert "1 sample with all joints at one point" in words(recording)
    assert clean_recording(recording).trajectory.sample_count == 40


LOST = np.where((np.arange(21) == 8)[:, None], np.nan, joint_sample().named())


@pytest.mark.parametrize(
    ("position", "message"),
    [
        (LOST, "no sample holds all 21 joints; missing: index_tip"),
        (np.full((40, 21, 3), np.nan), "wrist and the four knuckles"),
        (np.ones((40, 21, 3)) * np.arange(21)[:, None] * 1e-300, "expected the joints of a hand"),
        (joint_sample().named()[:, :20], r"position has shape \(40, 20, 3\)"),
    ],
)
def test_what_is_no_hand_is_refused(position: FloatArray, message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        read(joint_sample(), position=position, unit=None)


OPTIONS = ReadOptions(rate=100.0, world_up="y", hand="right")


def test_a_misplaced_joint_is_told_with_its_sample_and_distance(tmp_path: Path) -> None:
    points = joint_sample().named().copy()
    bone = points[7, 6] - points[7, 5]
    # Along the bone, so that its length changes by as much.
    points[7, 6:9] += 0.03 * bone / np.linalg.norm(bone)
    path = tmp_path / "take.npy"
    path.write_bytes(array_npy(points))
    cleaned = clean_recording(read_recording(path, OPTIONS))
    (told,) = (each for each in cleaned.findings if "a joint out of line" in each.text)
    # The neighbours' chords hold the joint, too.
    assert (told.kind, told.samples, told.first_time) == ("suspect", 3, 0.06) and "by up to 30.1 mm" in told.text


def test_a_signalling_nan_of_float32_is_missing_without_a_warning(tmp_path: Path) -> None:
    points = joint_sample().named().astype(np.float32)
    points.view(np.uint32)[3, 4, 1] = 0x7F800001
    path = tmp_path / "take.npy"
    path.write_bytes(array_npy(points))
    with np.errstate(invalid="raise"):
        recording = read_recording(path, OPTIONS)
    assert np.isnan(recording.flexion[3]).any() and np.isfinite(recording.flexion[4]).all()
