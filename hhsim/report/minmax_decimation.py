"""Min-max decimation of curves with more ticks than a picture has columns."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.arrays import FloatArray


class MinMaxBand(NamedTuple):
    """Middle of each of n stretches of the axis, and least value, median and largest value there (NaN without any)."""

    at: FloatArray
    low: FloatArray
    middle: FloatArray
    high: FloatArray


def minmax_band(at: FloatArray, values: NDArray[np.floating], stretches: int) -> MinMaxBand:
    """Return the band of a curve; the curve itself where it has no more values than stretches.

    Args:
        at: Abscissa of each value, shape (T,).
        values: Shape (T,); NaN where undefined.
    """
    if len(values) <= stretches:
        whole = np.asarray(values, np.float64)
        return MinMaxBand(at, whole, whole, whole)
    edges = np.linspace(0, len(values), stretches + 1).astype(np.int64)
    starts = edges[:-1]
    # NaN is no value: fmin and fmax pass it over.
    low, high = (np.asarray(reduce.reduceat(values, starts), np.float64) for reduce in (np.fmin, np.fmax))
    middle = np.full(stretches, np.nan)
    for k in np.flatnonzero(np.isfinite(low)):
        middle[k] = np.nanmedian(values[edges[k] : edges[k + 1]])
    return MinMaxBand(0.5 * (at[starts] + at[edges[1:] - 1]), low, middle, high)
