"""A fixed workload by which times of two machines are divided: the kind of work of a tick, and never changed.

Whoever changes anything here raises `REFERENCE_VERSION`: baselines of another version are then not comparable. It
imports no other kernel, so that no change of the solver is a change of the yardstick.
"""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import thread_cpu_ns
from hhsim.kernels.jit import jit

Array = NDArray[np.float64]

REFERENCE_VERSION = 1
SPHERES = 512
ROWS = 21


@jit
def reference_tick(center: Array, radius: Array, matrix: Array, factor: Array, position: float) -> float:
    """One workload: distances to (3, S) spheres with a branch each, and a (21, 21) Cholesky factor; returns a sum."""
    total = 0.0
    for i in range(radius.shape[0]):
        x, y, z = center[0, i] - position, center[1, i], center[2, i]
        square = x * x + y * y + z * z
        if square < 0.5:
            total += np.sqrt(square) - radius[i]
    n = matrix.shape[0]
    for i in range(n):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= factor[i, k] * factor[j, k]
            if i == j:
                factor[i, i] = np.sqrt(value)
            else:
                factor[i, j] = value / factor[j, j]
    return total + factor[n - 1, n - 1]


@jit
def time_reference(center: Array, radius: Array, matrix: Array, factor: Array, duration: NDArray[np.int64]) -> float:
    """Run the workload once for each element of `duration` and write its CPU time there [ns]; returns a sum."""
    total = 0.0
    for i in range(duration.shape[0]):
        began = thread_cpu_ns()
        total += reference_tick(center, radius, matrix, factor, 0.001 * (i % 100))
        duration[i] = thread_cpu_ns() - began
    return total
