"""Angles from bones, held against our own forward kinematics."""

from typing import Literal

import numpy as np
import pytest

from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion
from hhsim.recordings.finger_ik import finger_angles, finger_axes, finger_joints, palm_origin
from hhsim.recordings.frames import in_palm


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_angles_of_our_own_hand_come_back(side: Literal["right", "left"]) -> None:
    hand = HandModel.default(side)
    random = np.random.default_rng(7)
    count = 40
    flexion = random.uniform(hand.flexion_min, hand.flexion_max, (count, 5, 3))
    abduction = random.uniform(hand.abduction_min, hand.abduction_max, (count, 5))
    orientation = quaternion(random.normal(0.0, 1.0, (count, 3)))
    position = random.normal(0.0, 0.2, (count, 3))
    joints = np.stack(
        [hand.joints(*pose) for pose in zip(position, orientation, flexion, abduction)]  # world
    )
    bones = in_palm(np.diff(joints, axis=2), orientation)
    fitted_flexion, fitted_abduction = finger_angles(bones, side)
    assert np.abs(fitted_flexion - flexion).max() < 1e-9, "a fist has not turned the other way round"
    assert np.abs(fitted_abduction - abduction).max() < 1e-9
    local = finger_joints(hand.base, hand.length, flexion, abduction, finger_axes(side))
    assert np.allclose(in_palm(joints - position[:, None, None], orientation), local, atol=1e-12)
    knuckles = joints[:, 1:, 0]
    assert np.allclose(palm_origin(knuckles, orientation, side), position, atol=1e-9)


def test_a_missing_bone_makes_its_finger_missing() -> None:
    bones = np.random.default_rng(9).normal(size=(3, 5, 3, 3))
    bones[1, 2, 0] = np.nan
    bones[2, 4, 1] = 0.0
    flexion, abduction = finger_angles(bones, "right")
    lost = np.isnan(abduction)
    assert np.argwhere(lost).tolist() == [[1, 2], [2, 4]]
    assert np.isnan(flexion).any(axis=2).tolist() == lost.tolist()


def test_where_the_bones_decide_nothing_a_finger_is_not_spread() -> None:
    # All three straight down from the palm: any abduction has that plane, and noise would choose one at random.
    hand = HandModel.default()
    flexion = np.tile([0.5 * np.pi, 0.0, 0.0], (200, 5, 1))
    joints = finger_joints(hand.base, hand.length, flexion, np.zeros((200, 5)), finger_axes("right"))
    noisy = joints + np.random.default_rng(11).normal(0.0, 2e-4, joints.shape)
    _, abduction = finger_angles(np.diff(noisy, axis=2), "right")
    # A hundredth of a radian a bone, squared, over a weight of 0.05.
    assert np.abs(abduction).max() < 0.1
    _, none = finger_angles(np.diff(joints, axis=2), "right")
    assert np.abs(none).max() < 0.2
