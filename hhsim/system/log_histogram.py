"""Percentiles of any number of values in constant memory."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import IntArray


class LogHistogram:
    """Counts of positive values in bins of equal ratio.

    A percentile is off by less than half a bin, 0.1 %; the maximum is exact.
    """

    RATIO = 1.002
    LEAST = 1.0
    """Smallest value; those below count as this."""
    BINS = 17_000
    """Number of bins, up to LEAST · RATIO ** BINS, about 6e14: days, in ns."""

    def __init__(self) -> None:
        self.counts: IntArray = np.zeros(self.BINS, dtype=np.int64)
        self.largest = np.nan

    def add(self, values: ArrayLike) -> None:
        """Count values of any shape."""
        array = np.asarray(values, dtype=np.float64).ravel()
        place = np.log(np.maximum(array, self.LEAST) / self.LEAST) / np.log(self.RATIO)
        np.add.at(self.counts, np.minimum(place.astype(np.int64), self.BINS - 1), 1)
        self.largest = float(np.fmax.reduce(array, initial=self.largest))

    @property
    def count(self) -> int:
        """Number of values."""
        return int(self.counts.sum())

    def percentile(self, percent: float) -> float:
        """Return the nearest-rank percentile; NaN without any values."""
        if self.count == 0:
            return np.nan
        rank = max(1, int(np.ceil(0.01 * percent * self.count)))
        place = int(np.searchsorted(np.cumsum(self.counts), rank))
        return float(min(self.LEAST * self.RATIO ** (place + 0.5), self.largest))
