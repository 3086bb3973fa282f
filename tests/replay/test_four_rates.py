"""One motion recorded at four rates: the figures that the documentation states of their difference."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from recording_samples import read_as

from hhsim.arrays import FloatArray
from hhsim.motion.resample import interpolate_monotone, tick_times
from hhsim.motion.trajectory import Trajectory
from hhsim.recordings.cleaning import clean_recording


@cache
def motion(folder: Path, name: str) -> Trajectory:
    return clean_recording(read_as("npz", (folder / "recordings" / f"leap_{name}.npz").read_bytes())).trajectory


def channels(motion: Trajectory, ticks: FloatArray) -> FloatArray:
    """Position [m], flexion and abduction [rad] at ticks, shape (N, 23)."""
    values = np.concatenate([motion.position, motion.flexion.reshape(-1, 15), motion.abduction], axis=1)
    return interpolate_monotone(motion.time, values, ticks)


@pytest.mark.parametrize(
    ("name", "factor", "mean", "most", "angle"),
    [("half", 2, 0.08e-3, 4.5e-3, 6.4), ("quarter", 4, 0.18e-3, 9.2e-3, 10.9), ("eighth", 8, 0.4e-3, 7.7e-3, 13.9)],
)
def test_what_the_rates_differ_by(
    shared_data: Path, name: str, factor: int, mean: float, most: float, angle: float
) -> None:
    """Palm [m], in the mean and at most, and joint angles [°] at most."""
    fine = motion(shared_data, "confidence-demo")
    coarse = motion(shared_data, f"confidence-demo-{name}-res")
    assert (coarse.time == fine.time[::factor]).all() and (coarse.position == fine.position[::factor]).all()
    ticks = tick_times(float(coarse.time[-1]), 1000.0)
    difference = np.abs(channels(fine, ticks) - channels(coarse, ticks))
    assert np.linalg.norm(difference[:, :3], axis=1).mean() < mean and difference[:, :3].max() < most
    assert np.degrees(difference[:, 3:].max()) < angle
