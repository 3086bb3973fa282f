"""Motions by formula, held against scipy's rotations."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from sphere_scenes import bumpy_ball

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.errors import TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import conjugate, quaternion, quaternion_product, rotation_matrix, rotation_vector
from hhsim.motion.analytic_motion import hold_readings, random_targets, replayed, still, trajectory_of
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.motion.trajectory import ResampleMode
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

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


HAND = HandModel.default()
WILD = StressOptions(wild=True, hold=20)


def equal(one: HandConfiguration, other: HandConfiguration) -> bool:
    return all(a.tobytes() == b.tobytes() for a, b in zip(one, other))


def test_a_tick_without_a_reading_repeats_the_last_one() -> None:
    motion = RandomTargets(HAND, 1, StressOptions(hold=1, bound="none")).take(6)
    motion.position[0, 0] = np.nan
    motion.flexion[3, 2, 1] = np.inf
    motion.orientation[4] = 0.0
    assert equal(hold_readings(motion), motion.at(np.array([1, 1, 2, 2, 2, 5])))
    lost = motion._replace(abduction=np.full((6, 5), np.nan))
    assert np.isnan(hold_readings(lost).abduction).all()


@given(st.integers(0, 2**32 - 1), st.sampled_from(["coupled", "progressive"]))
@settings(max_examples=6)
def test_the_solver_goes_the_same_way_on_the_held_motion(seed: int, method: str) -> None:
    motion = RandomTargets(HAND, seed, WILD).take(200)
    tree = bumpy_ball(300).arrays()
    as_is, held = (
        HandSolver(HAND, tree, SolverOptions(method=method)).run(*m) for m in (motion, hold_readings(motion))
    )
    for name in ("position", "orientation", "flexion", "abduction", "total"):
        assert getattr(as_is, name).tobytes() == getattr(held, name).tobytes(), name


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


def test_a_trajectory_of_what_no_trajectory_may_hold_is_refused() -> None:
    motion = RandomTargets(HAND, 0).take(3)
    motion.position[1, 1] = np.nan
    with pytest.raises(TrajectoryError, match=r"position has 1 NaN.*sample 1"):
        trajectory_of(motion)
