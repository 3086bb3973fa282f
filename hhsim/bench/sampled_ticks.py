"""Some of many ticks, where all of them would take too long."""

from collections.abc import Sequence

import numpy as np

from hhsim.arrays import IntArray


def sampled(ticks: IntArray, count: int, also: Sequence[int] = ()) -> IntArray:
    """`count` of some ticks, evenly spread with both ends, or all of them if there are fewer; and `also`."""
    spread = ticks[np.linspace(0, ticks.size - 1, min(count, ticks.size)).astype(int)] if ticks.size else ticks
    return np.unique(np.concatenate([spread, np.array(also, np.int64)]).astype(np.int64))
