"""One motion recorded at four rates comes out as the same motion, within what its samples allow.

The coarse recordings hold every second, fourth and eighth sample of the fine one. Between two coarse samples a and b,
h apart, nothing is known but the fine ones; what separates the two interpolations there is bounded without any
assumption about the motion:

- A fine sample x at t is off the coarse chord by exactly (t - a)(b - t) |x[a, t, b]|, and this divided difference is a
  mean, with positive weights, of those of neighbouring fine samples between a and b. So it is at most
  (t - a)(b - t) max |x[j-1, j, j+1]|: a quarter of h² times half the largest acceleration.
- The shape-preserving cubic is off its chord by at most s (1 - s) h ((1 - s) |S - S₋| + s |S₊ - S|), with S the slope
  of this interval and S₋, S₊ those beside it: its slope at a sample lies between the two secants, or is zero where they
  have different signs. That holds for the coarse and for the fine curve.

The sum of the three bounds the difference at every tick. Orientations, which go along great arcs, are compared at the
fine stamps, as rotation vectors from the coarse sample before: the exponential map of rotations does not stretch.
"""

from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from recording_samples import read_as

from hhsim.arrays import FloatArray
from hhsim.motion.resample import interpolate_monotone, tick_times
from hhsim.motion.trajectory import Trajectory
from hhsim.recordings.repair import RepairOptions, repair

RATES = {"half": 2, "quarter": 4, "eighth": 8}
ROUNDING = 1e-12


@cache
def motion(folder: Path, name: str, limited: bool = True) -> Trajectory:
    data = (folder / "recordings" / f"leap_{name}.npz").read_bytes()
    return repair(read_as("npz", data), RepairOptions() if limited else RepairOptions(limits=None)).trajectory


def channels(motion: Trajectory) -> FloatArray:
    """Position [m], flexion and abduction [rad], shape (T, 23)."""
    return np.concatenate([motion.position, motion.flexion.reshape(-1, 15), motion.abduction], axis=1)


def cubic_bound(time: FloatArray, values: FloatArray, ticks: FloatArray) -> FloatArray:
    """How far the shape-preserving cubic can be off the chord at each tick, shape (N, C)."""
    slope = np.diff(values, axis=0) / np.diff(time)[:, None]
    change = np.abs(np.diff(slope, axis=0))
    # At the ends the slope comes from the two nearest secants.
    before, after = np.concatenate([change[:1], change]), np.concatenate([change, change[-1:]])
    i = np.clip(np.searchsorted(time, ticks, side="right") - 1, 0, len(time) - 2)
    h = np.diff(time)[i][:, None]
    s = ((ticks - time[i]) / np.diff(time)[i])[:, None]
    return np.asarray(s * (1.0 - s) * h * ((1.0 - s) * before[i] + s * after[i]))


def chord_bound(time: FloatArray, values: FloatArray, coarse: FloatArray) -> FloatArray:
    """How far each fine sample can be off the coarse chord, shape (T, C)."""
    slope = np.diff(values, axis=0) / np.diff(time)[:, None]
    second = np.abs(np.diff(slope, axis=0) / (time[2:] - time[:-2])[:, None])
    bound = np.zeros(values.shape)
    index = np.searchsorted(time, coarse)
    for a, b in pairwise(index):
        t = time[a : b + 1][:, None]
        most = second[a : b - 1].max(axis=0) if b - a > 1 else 0.0
        bound[a : b + 1] = (t - time[a]) * (time[b] - t) * most
    return bound


def compare(fine: Trajectory, coarse: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Difference and bound at every tick of 1 kHz that both have, shape (N, C)."""
    ticks = tick_times(float(coarse.time[-1]), 1000.0)
    one, other = channels(fine), channels(coarse)
    difference = np.abs(interpolate_monotone(fine.time, one, ticks) - interpolate_monotone(coarse.time, other, ticks))
    at_samples = chord_bound(fine.time, one, coarse.time)
    i = np.clip(np.searchsorted(fine.time, ticks, side="right") - 1, 0, len(fine.time) - 2)
    u = ((ticks - fine.time[i]) / (fine.time[i + 1] - fine.time[i]))[:, None]
    between = (1.0 - u) * at_samples[i] + u * at_samples[i + 1]
    bound = between + cubic_bound(fine.time, one, ticks) + cubic_bound(coarse.time, other, ticks) + ROUNDING
    return difference, bound


@pytest.mark.parametrize("limited", [True, False], ids=["within the limits", "as recorded"])
@pytest.mark.parametrize(("name", "factor"), RATES.items())
def test_one_motion_at_four_rates(shared_data: Path, name: str, factor: int, limited: bool) -> None:
    fine = motion(shared_data, "confidence-demo", limited)
    coarse = motion(shared_data, f"confidence-demo-{name}-res", limited)
    assert (coarse.time == fine.time[::factor]).all() and (channels(coarse) == channels(fine)[::factor]).all()
    difference, bound = compare(fine, coarse)
    assert (difference <= bound).all()
    # The bound says something: it is a few times what it bounds, and small beside the motion.
    assert np.percentile(bound[:, :3], 99) < {2: 0.005, 4: 0.015, 8: 0.05}[factor]
    assert difference.max() > 0.1 * bound[np.unravel_index(int(difference.argmax()), difference.shape)]


@pytest.mark.parametrize(("name", "mean", "most", "angle"), [
    ("half", 0.08e-3, 4.5e-3, 6.4), ("quarter", 0.18e-3, 9.2e-3, 10.9), ("eighth", 0.4e-3, 7.7e-3, 13.9),
])  # fmt: skip
def test_what_the_rates_differ_by(shared_data: Path, name: str, mean: float, most: float, angle: float) -> None:
    """The figures that the documentation states: palm [m], in the mean and at most, and joint angles [°] at most."""
    fine = motion(shared_data, "confidence-demo")
    difference, _ = compare(fine, motion(shared_data, f"confidence-demo-{name}-res"))
    palm = np.linalg.norm(difference[:, :3], axis=1)
    assert palm.mean() < mean and difference[:, :3].max() < most
    assert np.degrees(difference[:, 3:].max()) < angle
