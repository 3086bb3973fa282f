"""Histogram of tick times in bins of equal ratio."""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import jit


@jit
def count_time(counts: NDArray[np.int64], largest: NDArray[np.int64], ratio: float, time_ns: int) -> None:
    """Count a time [ns], at least 1, in the bins of a `hhsim.system.log_histogram.LogHistogram` of this ratio."""
    place = int(math.log(max(float(time_ns), 1.0)) / math.log(ratio))
    counts[min(place, counts.shape[0] - 1)] += 1
    largest[0] = max(largest[0], time_ns)
