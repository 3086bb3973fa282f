"""Motions by formula, held against scipy's rotations."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import conjugate, quaternion, quaternion_product, rotation_matrix, rotation_vector
from hhsim.motion.analytic_motion import random_targets, still

SEEDS = st.integers(0, 2**32 - 1)


@given(SEEDS, st.sampled_from([0.0, 1e-14, 1e-6, 1.0, 3.0]))
def test_rotations_are_those_of_scipy(seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    first, second = size * random.normal(size=(4, 3)), random.normal(size=(4, 3))
    ours, theirs = quaternion(first), Rotation.from_rotvec(first)
    np.testing.assert_allclose(np.abs(np.sum(ours * theirs.as_quat(scalar_first=True), axis=1)), 1.0, atol=1e-14)
    np.testing.assert_allclose(rotation_vector(ours), theirs.as_rotvec(), atol=1e-13)
    product = Rotation.from_quat(quaternion_product(ours, quaternion(second)), scalar_first=True)
    np.testing.assert_allclose(product.as_matrix(), (theirs * Rotation.from_rotvec(second)).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(quaternion_product(ours, conjugate(ours)), np.tile([1.0, 0, 0, 0], (4, 1)), atol=1e-15)
    np.testing.assert_allclose(rotation_matrix(ours[0]), theirs[0].as_matrix(), atol=1e-14)


def test_a_line_goes_at_constant_speed_and_arrives() -> None:
    start = still((0.0, 0.0, 0.1), quaternion(np.array([0.1, 0.0, 0.0])), 0.2)
    goal = still((0.1, 0.0, 0.0), quaternion(np.array([0.0, 0.9, 0.3])), 0.5, 0.1)
    motion = start.hold(3).line(goal, 10).hold(5)
    assert motion.ticks == 19
    for values, first, last in zip(motion, start, goal, strict=True):
        np.testing.assert_array_equal(values[:4], np.repeat(first, 4, axis=0))
        np.testing.assert_allclose(values[13:], np.repeat(last, 6, axis=0), atol=1e-15)
    steps = np.diff(motion.position[3:14], axis=0)
    np.testing.assert_allclose(steps, np.tile(steps[0], (10, 1)), atol=1e-15)
    turns = rotation_vector(quaternion_product(motion.orientation[4:14], conjugate(motion.orientation[3:13])))
    np.testing.assert_allclose(turns, np.tile(turns[0], (10, 1)), atol=1e-13)


def test_random_targets_are_reproducible_and_within_the_limits() -> None:
    hand = HandModel.default()
    motion = random_targets(hand, 100, np.random.default_rng(1), hold=30)
    again = random_targets(hand, 100, np.random.default_rng(1), hold=30)
    for one, other in zip(motion, again, strict=True):
        np.testing.assert_array_equal(one, other)
    assert motion.ticks == 100
    assert (np.diff(motion.position[:30], axis=0) == 0.0).all()
    assert len(np.unique(motion.position[:, 0])) == 4
    assert ((motion.flexion >= hand.flexion_min) & (motion.flexion <= hand.flexion_max)).all()
    assert ((motion.abduction >= hand.abduction_min) & (motion.abduction <= hand.abduction_max)).all()
