"""Times of the ticks of a session, counted without waiting for anything in a tick."""

import numpy as np
from numpy.typing import NDArray

from hhsim.system.log_histogram import LogHistogram

BATCH = 512
"""Times that are kept before they are counted together: one at a time costs 20 µs."""
PERCENTS = (50.0, 99.0, 99.9)


class TickTimes:
    """Percentiles of times [ns] of any number of ticks."""

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._histogram = LogHistogram()
        self._waiting: NDArray[np.int64] = np.zeros(BATCH, np.int64)
        self._count = 0

    def add(self, time_ns: int) -> bool:
        """Count a time; True where the batch is full, and `count` is due before long."""
        if self._count == BATCH:
            self.count()
        self._waiting[self._count] = time_ns
        self._count += 1
        return self._count == BATCH

    def count(self) -> None:
        """Take the times that wait into the histogram."""
        self._histogram.add(self._waiting[: self._count])
        self._count = 0

    def percentile(self, percent: float) -> int:
        """Of what has been counted [ns], -1 where nothing has."""
        value = self._histogram.percentile(percent)
        return -1 if np.isnan(value) else round(value)

    def summary(self) -> dict[str, int]:
        """All of it: count, p50, p99, p99.9 and max [ns], -1 where there is none."""
        self.count()
        largest = self._histogram.largest
        return {
            "count": self._histogram.count,
            **{f"p{percent:g}": self.percentile(percent) for percent in PERCENTS},
            "max": -1 if np.isnan(largest) else round(largest),
        }
