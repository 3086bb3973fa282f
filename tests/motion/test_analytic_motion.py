"""Motions by formula, held against scipy's rotations."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import conjugate, quaternion, quaternion_product, rotation_matrix, rotation_vector
from hhsim.motion.analytic_motion import replayed, still, trajectory_of
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.motion.trajectory import ResampleMode

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


HAND = HandModel.default()
WILD = StressOptions(wild=True, hold=20)


def equal(one: HandConfiguration, other: HandConfiguration) -> bool:
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_a_replay_from_a_file_gets_the_replayed_motion_bit_for_bit(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    motion = replayed(RandomTargets(HAND, seed, WILD).take(200))
    path: Path = tmp_path_factory.mktemp("motion") / "wild.h5"
    save_trajectory(trajectory_of(motion, name="wild", source="a test"), path)
    modes: tuple[ResampleMode, ...] = ("hold", "interpolate")
    for mode in modes:
        ticks = load_trajectory(path).resampled(1000.0, mode)
        assert equal(HandConfiguration.of(ticks), motion)
    assert equal(replayed(motion), motion)
