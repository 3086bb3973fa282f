"""The frontier of a trade-off: what nothing else beats in both."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def frontier(time: ArrayLike, error: ArrayLike, gain: float = 0.0) -> NDArray[np.int64]:
    """Indices of the points that no other point beats, by growing time.

    A point beats another if it is no worse in both and better in one. Of equal points the first counts; a point with a
    NaN is on no frontier.

    Args:
        time: Shape (n,); less is better.
        error: Shape (n,); less is better.
        gain: A slower point counts only if its error is smaller than that of the frontier before it by more than this
            share of it, so that a hair's breadth earns no place; 0 gives the plain frontier.
    """
    first, second = np.asarray(time, np.float64).ravel(), np.asarray(error, np.float64).ravel()
    order = np.lexsort((np.arange(first.size), second, first))
    order = order[~(np.isnan(first[order]) | np.isnan(second[order]))]
    if order.size == 0:
        return order
    kept = [int(order[0])]
    for index in order[1:]:
        best = second[kept[-1]]
        if second[index] < (best - gain * abs(best) if np.isfinite(best) else best):
            kept.append(int(index))
    return np.array(kept, np.int64)
