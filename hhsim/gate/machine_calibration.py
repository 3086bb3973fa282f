"""The yardstick of times that were taken on another machine: CPU time of a fixed workload on this one."""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.machine_calibration import ROWS, SPHERES, time_reference


def reference_p50(repeats: int = 2_000) -> float:
    """Median CPU time of the workload on this machine now [s]; the first call compiles it, or loads it."""
    center, radius, matrix = reference_input()
    factor = np.zeros_like(matrix)
    time_reference(center, radius, matrix, factor, np.zeros(10, np.int64))
    duration = np.zeros(repeats, np.int64)
    time_reference(center, radius, matrix, factor, duration)
    return float(np.median(duration)) * 1e-9


def reference_input() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Centres (3, S), radii (S,) and a positive definite matrix (21, 21), the same numbers for ever."""
    index = np.arange(3 * SPHERES, dtype=np.float64)
    center = ((index * 0.6180339887498949) % 1.0).reshape(3, SPHERES)
    radius = np.asarray(0.01 + 0.01 * ((np.arange(SPHERES) * 0.7548776662466927) % 1.0), dtype=np.float64)
    row = np.arange(ROWS, dtype=np.float64)
    matrix = np.exp(-np.abs(row[:, None] - row[None, :]) / 4.0) + np.eye(ROWS)
    return center, radius, matrix
