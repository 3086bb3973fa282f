"""Least-squares fit of joints: known hands come back, planes do not flip, and no limit cuts a fitted angle."""

from typing import Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from joint_samples import Side, arrays_npz, joint_sample, openxr_csv, words
from recording_samples import read_as, smooth_recording
from sampled import sampled

from hhsim.arrays import FloatArray
from hhsim.errors import TrajectoryError
from hhsim.hand.model import SIDES, HandModel
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


@settings(max_examples=15, deadline=None)
@given(side=st.sampled_from(SIDES), length=st.floats(0.15, 0.21), seed=st.integers(0, 10_000), count=st.integers(1, 30))
@pytest.mark.soak
def test_known_angles_come_back(side: Side, length: float, seed: int, count: int) -> None:
    hand = HandModel.default(side, hand_length=length)
    random = np.random.default_rng(seed)
    # Unrelated samples: no motion may be taken for a flip.
    flexion = random.uniform(hand.flexion_min, hand.flexion_max, (count, 5, 3))
    abduction = random.uniform(hand.abduction_min, hand.abduction_max, (count, 5))
    axes = finger_axes(side)
    joints = finger_joints(hand.base, hand.length, flexion, abduction, axes)
    found, aside = fitted_angles(joints, hand.base, hand.length, axes, side)
    again = finger_joints(hand.base, hand.length, found, aside, axes)
    assert np.abs(again - joints).max() < 1e-7
    # A finger that is straight down from its base has any abduction.
    reach = np.abs(joints[:, :, 1:] - hand.base[:, None]) - np.abs(
        ((joints[:, :, 1:] - hand.base[:, None]) @ axes.dorsal[:, :, None]) * axes.dorsal[:, None]
    )
    clear = np.linalg.norm(reach, axis=(2, 3)) > 0.01
    assert np.abs(np.where(clear, aside - abduction, 0.0)).max() < 1e-5


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
    assert moved.joints is not None and moved.bones is not None
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
    k = 11
    joints = hand.joints(moved.position[k], moved.orientation[k], moved.flexion[k], moved.abduction[k])
    own = sample.hand.joints(
        sample.motion.position[k], sample.motion.orientation[k], sample.motion.flexion[k], sample.motion.abduction[k]
    )
    assert np.abs(joints[:, :3] - own[:, :3]).max() < 5e-6


def test_what_gives_no_hand_is_refused() -> None:
    with pytest.raises(TrajectoryError, match="needs the centres of the joints, and test holds"):
        fitted_hand(smooth_recording(), "")


def test_radii_beside_an_array_of_points_are_the_hand_s() -> None:
    sample = joint_sample(length=0.17)
    radius = np.array([sample.radius[OPENXR_JOINTS.index(name)] for name in KEYPOINTS])
    for stated in (radius, np.tile(radius, (len(sample.joints), 1))):
        recording = read_as("keypoints", arrays_npz(joints=sample.named(), t=sample.motion.time, radius=stated))
        assert recording.bones is not None and recording.bones.radius is not None
        assert np.allclose(recording.bones.radius, sample.hand.radius, atol=1e-6) and "radius" not in words(recording)
