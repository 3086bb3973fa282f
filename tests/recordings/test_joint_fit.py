"""Joints as angles: units, sides and holes of what is read, known angles come back, and hands of other sizes."""

from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from conftest import sampled
from joint_samples import JointSample, Side, array_npy, arrays_npz, joint_sample, openxr_csv, words
from recording_samples import read_as, smooth_recording

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import SIDES, HandModel
from hhsim.motion.sample_flags import SampleFlag, marked
from hhsim.recordings.cleaning import CleaningOptions, clean_recording
from hhsim.recordings.finger_ik import (
    LARGEST_STEP,
    USUAL_STEP,
    FingerAxes,
    anatomic_limits,
    finger_angles,
    finger_axes,
    finger_joints,
    fitted_angles,
)
from hhsim.recordings.fitted_hand import fitted_axes, fitted_hand, recorded_limits
from hhsim.recordings.joint_names import KEYPOINTS, OPENXR_JOINTS
from hhsim.recordings.joint_positions import JointPositions, recording_of_joints
from hhsim.recordings.recording import Recording
from hhsim.recordings.registry import Content, ReadOptions, read_recording


def read(sample: JointSample, options: ReadOptions | None = None, **fields: Any) -> Recording:
    given = {"time": sample.motion.time, "position": sample.named(), "up": "y", "unit": 1.0, "time_unit": "s"}
    positions, content = JointPositions(**given | fields), Content(data=b"", name="take")
    return recording_of_joints(positions, content, options or ReadOptions())


@pytest.mark.parametrize("noise", [0.0005, 0.002])
def test_the_error_of_the_fit_is_that_of_the_noise(noise: float) -> None:
    recording = read(joint_sample(count=400, noise=noise))
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
        assert recording.bones.hand_length == pytest.approx(0.1835, abs=1e-3)
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


def turned_axes(side: Side, along: float, across: float) -> FingerAxes:
    """Axes whose dorsal ones lean by these tangents along and across each finger."""
    distal, dorsal, aside = finger_axes(side)
    leaning = dorsal + along * distal + across * aside
    leaning /= np.linalg.norm(leaning, axis=1, keepdims=True)
    onward = distal - (distal * leaning).sum(axis=1, keepdims=True) * leaning
    onward /= np.linalg.norm(onward, axis=1, keepdims=True)
    return FingerAxes(onward, leaning, (-1.0 if side == "left" else 1.0) * np.cross(leaning, onward))


def wave(hand: HandModel, count: int, seed: int, share: float = 0.8) -> tuple[FloatArray, FloatArray]:
    """Smooth flexions and abductions within a share of the limits."""
    random = np.random.default_rng(seed)
    time = np.linspace(0.0, 2.0 * np.pi, count)[:, None]

    def within(low: FloatArray, high: FloatArray) -> FloatArray:
        phase, pace = random.uniform(0.0, 6.0, low.size), random.uniform(0.5, 2.0, low.size)
        swing = 0.5 * share * np.sin(pace * time + phase)
        return np.asarray((0.5 * (low + high).ravel() + swing * (high - low).ravel()).reshape(count, *low.shape))

    return within(hand.flexion_min, hand.flexion_max), within(hand.abduction_min, hand.abduction_max)


@pytest.mark.parametrize("side", SIDES)
def test_a_straight_finger_keeps_the_plane_of_the_sample_before(side: Side) -> None:
    hand, axes = HandModel.default(side), finger_axes(side)
    count = 120
    bend = np.concatenate([np.linspace(0.3, 0.0, 30), np.zeros(60), np.linspace(0.0, 0.3, 30)])
    flexion = np.tile(np.array([0.5 * np.pi, 0.0, 0.0]), (count, 5, 1))
    flexion[:, :, 0] -= bend[:, None]
    flexion[:, :, 1] = 2.0 * bend[:, None]
    abduction = np.full((count, 5), 0.2)
    exact = finger_joints(hand.base, hand.length, flexion, abduction, axes)
    # The thumb's first joint bends by 50° at most.
    aside = fitted_angles(exact, hand.base, hand.length, axes, side)[1][:, 1:]
    assert np.abs(aside[30:90] - 0.2).max() < 1e-3, "the joints say nothing there"
    noisy = exact + np.random.default_rng(4).normal(0.0, 5e-4, exact.shape)
    aside = fitted_angles(noisy, hand.base, hand.length, axes, side)[1][:, 1:]
    assert np.abs(np.diff(aside, axis=0)).max() < 2.0 * USUAL_STEP


def test_a_finger_that_leaves_its_plane_does_not_flip() -> None:
    # Bent sideways by more than the planes of the usual axes hold: the nearest plane changes sides from sample to
    # sample, while the joints move by a millimetre.
    hand, axes = HandModel.default(), finger_axes("right")
    count = 60
    lean = turned_axes("right", 0.0, 0.7)
    flexion = np.tile(np.array([1.35, 0.35, 0.2]), (count, 5, 1))
    flexion[:, :, 0] += 0.4 * np.sin(np.linspace(0.0, 6.0, count))[:, None]
    joints = finger_joints(hand.base, hand.length, flexion, np.full((count, 5), 0.05), lean)
    joints = joints + np.random.default_rng(6).normal(0.0, 3e-4, joints.shape)
    before = finger_angles(np.diff(joints, axis=2), finger_axes("right"))[1]
    found, aside = fitted_angles(joints, hand.base, hand.length, axes, "right")
    assert np.abs(np.diff(before, axis=0)).max() > 1.0
    assert np.abs(np.diff(aside, axis=0)).max() < LARGEST_STEP and np.abs(np.diff(found, axis=0)).max() < LARGEST_STEP


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize(("along", "across"), [(0.0, 0.35), (0.3, -0.3), (-0.05, 0.6)])
@pytest.mark.quick("0.3--0.3-right", "-0.05-0.6-left")
def test_a_thumb_with_a_rolled_plane_is_fitted(side: Literal["right", "left"], along: float, across: float) -> None:
    hand, axes = HandModel.default(side), turned_axes(side, along, across)
    flexion, abduction = wave(hand, 150, 3)
    joints = finger_joints(hand.base, hand.length, flexion, abduction, axes)
    found = fitted_axes(joints, hand.base, side)
    bent, aside = fitted_angles(joints, hand.base, hand.length, found, side)
    off = np.linalg.norm(finger_joints(hand.base, hand.length, bent, aside, found) - joints, axis=3)
    assert off[:, 0].max() < 1e-4, "the thumb"
    assert off.max() < 1e-4
    assert np.allclose(np.linalg.norm(found.dorsal, axis=1), 1.0)
    assert np.allclose((found.dorsal * found.distal).sum(axis=1), 0.0, atol=1e-12)
    usual = fitted_angles(joints, hand.base, hand.length, finger_axes(side), side)
    worse = finger_joints(hand.base, hand.length, *usual, finger_axes(side)) - joints
    assert np.linalg.norm(worse, axis=3)[:, 0].max() > 1e-3, "the usual axes do not fit it"


def test_a_finger_that_is_always_far_aside_has_its_zero_moved() -> None:
    hand, axes = HandModel.default(), finger_axes("right")
    flexion, abduction = wave(hand, 150, 12, share=0.5)
    aside = abduction - 1.2
    joints = finger_joints(hand.base, hand.length, flexion, aside, axes)
    usual = finger_joints(hand.base, hand.length, *fitted_angles(joints, hand.base, hand.length, axes, "right"), axes)
    found = fitted_axes(joints, hand.base, "right")
    angles = fitted_angles(joints, hand.base, hand.length, found, "right")
    ours = finger_joints(hand.base, hand.length, *angles, found)
    assert np.linalg.norm(usual - joints, axis=3)[:, 1:].max() > 1e-3, "no abduction reaches it from the usual zero"
    assert np.linalg.norm(ours - joints, axis=3)[:, 1:].max() < 1e-4


def test_axes_that_no_abduction_shows_stay_the_usual_ones() -> None:
    hand, axes = HandModel.default(), finger_axes("right")
    flexion = wave(hand, 100, 8)[0]
    joints = finger_joints(hand.base, hand.length, flexion, np.zeros((100, 5)), axes)
    noisy = joints + np.random.default_rng(9).normal(0.0, 1e-3, joints.shape)
    found = fitted_axes(noisy, hand.base, "right")
    assert np.degrees(np.arccos((found.dorsal * axes.dorsal).sum(axis=1))).max() < 3.0


def test_limits_hold_the_recorded_motion_and_the_usual_one_within_anatomy() -> None:
    hand, axes = HandModel.default(), turned_axes("right", 0.4, 0.1)
    low, high = anatomic_limits(axes, "right")
    # Joints beyond any hand's range: the fit stops at the anatomic limits.
    flexion, abduction = np.full((20, 5, 3), 2.6), np.linspace(-0.5, 0.5, 20)[:, None] * np.ones(5)
    joints = finger_joints(hand.base, hand.length, flexion, abduction, axes)
    found, aside = fitted_angles(joints, hand.base, hand.length, axes, "right")
    assert (found >= low[:, 1:]).all() and (found <= high[:, 1:]).all()
    assert (found == high[:, 1:]).any()
    limits = recorded_limits(found, aside, axes, "right")
    assert (limits["flexion_min"] <= found).all() and (found <= limits["flexion_max"]).all()
    assert (limits["abduction_min"] <= aside).all() and (aside <= limits["abduction_max"]).all()
    # A leaning axis moves the zero of the first flexion: limits follow it.
    none = recorded_limits(np.full((1, 5, 3), np.nan), np.full((1, 5), np.nan), axes, "right")
    usual = finger_joints(hand.base, hand.length, hand.flexion_max[None], np.zeros((1, 5)), finger_axes("right"))
    shifted = finger_joints(hand.base, hand.length, none["flexion_max"][None], np.zeros((1, 5)), axes)
    first = [np.diff(joints, axis=2)[0, :, 0] / hand.length[:, :1] for joints in (usual, shifted)]
    assert (np.einsum("fi,fi->f", *first) > np.cos(0.15)).all()


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.quick("left")
def test_a_fitted_hand_holds_its_motion_without_a_cut(side: Side) -> None:
    sample = joint_sample(side, count=200, noise=0.003)
    moved, text = fitted_hand(read_as("openxr", openxr_csv(sample, side)), "take.csv")
    hand = HandModel.of_text(text, "take.toml", side)
    assert "limited" not in {finding.kind for finding in clean_recording(moved, CleaningOptions(limits=hand)).findings}
    fingers = moved.joints[:, 1:].reshape(-1, 5, 4, 3)
    poses = zip(moved.position, moved.orientation, moved.flexion, moved.abduction)
    off = np.linalg.norm(np.stack([hand.joints(*pose) for pose in poses]) - fingers, axis=3)
    # The file's fingertips are balls' centres, and its numbers have six decimals.
    rms = np.sqrt((off**2).mean(axis=(0, 2)))
    assert np.allclose(rms, moved.bones.rms, atol=2e-5)


@pytest.mark.parametrize(
    ("side", "radii"),
    sampled([(side, radii) for side in ("right", "left") for radii in (True, False)], lambda place, _: place in (0, 3)),
)
@pytest.mark.quick("right-True")
def test_a_hand_of_another_size_is_found(side: Side, radii: bool) -> None:
    sample = joint_sample(side, length=0.17)
    moved, text = fitted_hand(read_as("openxr", openxr_csv(sample, side, radii=radii)), "take.csv")
    assert ("radius" in text.split("\n", 1)[1]) is radii
    # A hand file has micrometres.
    hand = HandModel.of_text(text, "take.toml", side)
    assert hand.hand_length == pytest.approx(0.17, abs=1e-3 if radii else 0.008)
    assert hand.hand_breadth == pytest.approx(sample.hand.hand_breadth, abs=2e-6)
    bones = slice(None) if radii else slice(2)
    assert np.allclose(hand.length[:, bones], sample.hand.length[:, bones], atol=1e-6)
    assert np.allclose(hand.radius, sample.hand.radius, atol=1e-6) or not radii
    made = (hand, moved), (sample.hand, sample.motion)
    joints, own = (of.joints(*HandConfiguration.of(motion).at(11)) for of, motion in made)
    assert np.abs(joints[:, :3] - own[:, :3]).max() < 5e-6


def test_what_gives_no_hand_is_refused() -> None:
    with pytest.raises(TrajectoryError, match="needs the centres of the joints, and test holds"):
        fitted_hand(smooth_recording(), "")


def test_radii_beside_an_array_of_points_are_the_hand_s() -> None:
    sample = joint_sample(length=0.17)
    radius = np.array([sample.radius[OPENXR_JOINTS.index(name)] for name in KEYPOINTS])
    for stated in (radius, np.tile(radius, (len(sample.joints), 1))):
        recording = read_as("keypoints", arrays_npz(joints=sample.named(), t=sample.motion.time, radius=stated))
        assert np.allclose(recording.bones.radius, sample.hand.radius, atol=1e-6) and "radius" not in words(recording)
