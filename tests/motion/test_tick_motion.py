"""Motions as arrays: cut, held where nothing was read, and turned into trajectories without a changed bit."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sphere_scenes import bumpy_ball

from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.errors import TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.motion.analytic_motion import hold_readings, replayed, trajectory_of
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.motion.trajectory import ResampleMode
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions

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
