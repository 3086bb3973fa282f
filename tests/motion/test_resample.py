import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation, Slerp

from hhsim.arrays import FloatArray
from hhsim.motion.resample import interpolate_monotone, interpolate_orientation, newest_sample, tick_times


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
