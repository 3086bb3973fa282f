"""Motions by formula, resampling, and tremor, held against scipy and their own definitions."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation, Slerp

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.errors import TrajectoryError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import conjugate, quaternion, quaternion_product, rotation_matrix, rotation_vector
from hhsim.motion.analytic_motion import replayed, still, trajectory_of
from hhsim.motion.file import load_trajectory, save_trajectory
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation, newest_sample, tick_times
from hhsim.motion.trajectory import ResampleMode
from hhsim.motion.tremor import Disturbance


def stamps(rng: np.random.Generator, count: int) -> FloatArray:
    """Irregular stamps from 0 on, gaps of 1 to 40 ms."""
    return np.concatenate([[0.0], np.cumsum(rng.uniform(0.001, 0.04, count - 1))])


def test_tick_times_reach_the_last_stamp_in_spite_of_rounding() -> None:
    time = tick_times(np.float64(2999 * 0.001), 1000.0)
    assert time.shape == (3000,)
    assert time[-1] == 2999 / 1000.0
    assert tick_times(0.0, 1000.0).tolist() == [0.0]
    assert tick_times(0.0105, 1000.0).shape == (11,)


def test_newest_sample_is_the_last_one_not_after_the_tick() -> None:
    time = np.array([0.0, 0.010, 0.011, 0.030])
    ticks = np.array([0.0, 0.009, 0.010, 0.0105, 0.029, 0.030, 0.031])
    assert newest_sample(time, ticks).tolist() == [0, 0, 1, 1, 2, 3, 3]
    # 3 · 0.001 > 3 / 1000 in the last bit; the sample is there all the same.
    assert newest_sample(0.001 * np.arange(5.0), np.arange(5) / 1000.0).tolist() == [0, 1, 2, 3, 4]


@settings(max_examples=60)
@given(st.integers(3, 30), st.integers(0, 2**32 - 1), st.sampled_from([1e-300, 1e-6, 1.0, 1e6]))
def test_monotone_cubic_is_scipys_pchip(count: int, seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    time = stamps(rng, count)
    values = scale * rng.choice([rng.normal(size=(count, 4)), np.round(rng.normal(size=(count, 4)))])
    ticks = np.append(rng.uniform(0.0, time[-1], 200), time)
    ours = interpolate_monotone(time, values, ticks)
    if scale < 1e-200:
        # scipy's harmonic mean underflows there; the cubic scales, so compare at scale 1.
        theirs = scale * PchipInterpolator(time, values / scale)(ticks)
    else:
        theirs = PchipInterpolator(time, values)(ticks)
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-12 * scale)


@settings(max_examples=60)
@given(st.integers(2, 20), st.integers(0, 2**32 - 1), st.sampled_from([1e-9, 1e-4, 0.5, 1.5]))
def test_orientation_is_scipys_slerp(count: int, seed: int, step: float) -> None:
    rng = np.random.default_rng(seed)
    time = stamps(rng, count)
    rotation = Rotation.from_rotvec(np.cumsum(rng.normal(size=(count, 3)) * step, axis=0))
    quaternions = rotation.as_quat(scalar_first=True) * rng.choice([-1.0, 1.0], size=(count, 1))
    ticks = rng.uniform(0.0, time[-1], 100)
    ours = interpolate_orientation(time, quaternions, ticks)
    np.testing.assert_allclose(np.linalg.norm(ours, axis=1), 1.0, atol=1e-14)
    theirs = Slerp(time, rotation)(ticks)
    difference = (Rotation.from_quat(ours, scalar_first=True) * theirs.inv()).magnitude()
    assert difference.max() < 1e-9


def unmoved(count: int = 2000) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    time = np.arange(count) / 1000.0
    orientation = np.tile(Rotation.from_rotvec([0.3, -0.2, 1.0]).as_quat(scalar_first=True), (count, 1))
    return time, np.full((count, 3), 0.2), orientation, np.full((count, 5, 3), 0.5)


def test_tremor_has_the_stated_amplitude_and_frequency() -> None:
    time, position, orientation, flexion = unmoved()
    amplitude, angle = 1e-4, math.radians(0.2)
    tremor = Disturbance(tremor_position=amplitude, tremor_rotation=angle, tremor_frequency=10.0)
    for seed in range(5):
        moved, turned, same = tremor.apply(seed, time, position, orientation, flexion)
        assert same is flexion
        excursion = np.linalg.norm(moved - position, axis=1)
        assert excursion.max() == pytest.approx(amplitude, rel=1e-3)
        assert excursion.max() <= amplitude * (1.0 + 1e-12)
        turn = Rotation.from_quat(turned, scalar_first=True) * Rotation.from_quat(orientation, scalar_first=True).inv()
        assert turn.magnitude().max() == pytest.approx(angle, rel=1e-3)
        # Two whole seconds at 10 Hz: all of it in one line of the spectrum.
        spectrum = np.abs(np.fft.rfft(moved - position, axis=0)) ** 2
        assert spectrum[20].sum() == pytest.approx(spectrum.sum(), rel=1e-9)


def test_the_seed_decides_and_parts_do_not_depend_on_each_other() -> None:
    time, position, orientation, flexion = unmoved(200)
    both = Disturbance(tremor_position=1e-4, tremor_rotation=0.003, sensor_noise=0.001)
    one = both.apply(7, time, position, orientation, flexion)
    again = both.apply(7, time, position, orientation, flexion)
    other = both.apply(8, time, position, orientation, flexion)
    for a, b, c in zip(one, again, other):
        assert a.tobytes() == b.tobytes()
        assert a.tobytes() != c.tobytes()
    alone = Disturbance(tremor_position=1e-4).apply(7, time, position, orientation, flexion)
    assert alone[0].tobytes() == one[0].tobytes()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"tremor_position": -1e-4}, "tremor_position = -0.0001; expected a number from 0 to 0.1"),
        ({"sensor_counts": 1.5}, "sensor_counts = 1.5; expected a whole number"),
    ],
)
def test_values_out_of_range_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        Disturbance(**values)


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
