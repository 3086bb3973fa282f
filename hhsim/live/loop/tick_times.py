"""Times of the ticks of a session, which `hhsim.kernels.live.tick_times.count_time` counts."""

import numpy as np
from numpy.typing import NDArray

from hhsim.system.log_histogram import LogHistogram

PERCENTS = (50.0, 99.0, 99.9)


class TickTimes:
    """Percentiles of times [ns] of any number of ticks.

    Args:
        largest: Where the largest is kept, shape (1,).

    Attributes:
        counts: Bins.
    """

    def __init__(self, largest: NDArray[np.int64]) -> None:
        """Hold nothing yet."""
        self._histogram = LogHistogram()
        self.counts = self._histogram.counts
        self.largest = largest
        self.largest[:] = -1

    def percentile(self, percent: float) -> int:
        """Of what has been counted [ns], -1 where nothing has."""
        if self.largest[0] < 0:
            return -1
        self._histogram.largest = float(self.largest[0])
        return round(self._histogram.percentile(percent))

    def summary(self) -> dict[str, int]:
        """All of it: count, p50, p99, p99.9 and max [ns], -1 where there is none."""
        return {
            "count": self._histogram.count,
            **{f"p{percent:g}": self.percentile(percent) for percent in PERCENTS},
            "max": int(self.largest[0]),
        }
