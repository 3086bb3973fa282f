"""Configurations: how they move, what follows from them, and which are none."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.hand.model import HandModel
from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.hand.pose import HAND_POSE, copy_configuration, is_finite_configuration, move, update_kinematics

HAND = HandModel.default("right")
CONFIGURATION = ("position", "orientation", "flexion", "abduction")


def random_pose(random: np.random.Generator) -> Any:
    pose = np.zeros(1, HAND_POSE).view(np.recarray)[0]
    pose.position[:] = random.normal(size=3)
    pose.orientation[:] = Rotation.random(rng=random).as_quat(scalar_first=True)
    pose.flexion[:] = random.normal(size=(5, 3))
    pose.abduction[:] = random.normal(size=5)
    return pose


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.3, 1.0]))
@settings(max_examples=50)
def test_a_move_turns_from_the_left_and_adds_the_rest(seed: int, fraction: float) -> None:
    random = np.random.default_rng(seed)
    pose = random_pose(random)
    before = {name: np.array(pose[name]) for name in CONFIGURATION}
    step, spread = random.normal(size=DOF), random.normal(size=5)
    move(pose, step, spread, fraction)
    np.testing.assert_allclose(pose.position, before["position"] + fraction * step[:3], rtol=1e-14)
    np.testing.assert_allclose(pose.flexion, before["flexion"] + fraction * step[6:].reshape(5, 3), rtol=1e-13)
    np.testing.assert_allclose(pose.abduction, before["abduction"] + fraction * spread, rtol=1e-14)
    turned = Rotation.from_rotvec(fraction * step[3:6]) * Rotation.from_quat(before["orientation"], scalar_first=True)
    found = Rotation.from_quat(pose.orientation, scalar_first=True)
    assert (turned * found.inv()).magnitude() < 1e-12
    assert np.linalg.norm(pose.orientation) == pytest.approx(1.0, abs=1e-14)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=30)
def test_what_follows_is_brought_up_to_date_and_what_is_copied_is_not(seed: int) -> None:
    random = np.random.default_rng(seed)
    pose, other = random_pose(random), random_pose(random)
    update_kinematics(HAND.arrays(), pose)
    np.testing.assert_allclose(pose.joints, HAND.joints(*(pose[name] for name in CONFIGURATION)), atol=1e-14)
    matrix = Rotation.from_quat(pose.orientation, scalar_first=True).as_matrix()
    np.testing.assert_allclose(pose.rotation, matrix, atol=1e-14)
    np.testing.assert_allclose(
        pose.joints[:, 1:] - pose.joints[:, :3], HAND.length[..., None] * pose.direction, atol=1e-14
    )
    copy_configuration(pose, other)
    for name in CONFIGURATION:
        np.testing.assert_array_equal(other[name], pose[name])
    assert not other.joints.any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", CONFIGURATION)
def test_one_number_that_is_not_finite_spoils_a_configuration(name: str, value: float) -> None:
    pose = random_pose(np.random.default_rng(0))
    values = [np.array(pose[each]) for each in CONFIGURATION]
    assert is_finite_configuration(*values)
    spoilt = values[CONFIGURATION.index(name)]
    for place in np.ndindex(spoilt.shape):
        kept = spoilt[place]
        spoilt[place] = value
        assert not is_finite_configuration(*values)
        spoilt[place] = kept


def test_a_quaternion_of_no_length_is_none() -> None:
    flexion, abduction = np.zeros((5, 3)), np.zeros(5)
    assert not is_finite_configuration(np.zeros(3), np.zeros(4), flexion, abduction)
    assert is_finite_configuration(np.zeros(3), np.array([0.0, 0.0, -2.0, 0.0]), flexion, abduction)
