"""Ticks that did not reach the user's hand."""

import numpy as np

from hhsim.kernels.tick.state import STATUS_LAG, STATUS_NO_PLACE, STATUS_STUCK
from hhsim.metrics.run_metric import Judged, RunMetric, placed

MOST_STUCK = 0.5
"""Largest share of stuck ticks of a run whose hand follows."""


def is_mostly_stuck(stuck: float, ticks: int) -> bool:
    """True if more than half of the ticks are stuck: such a run misses its limits."""
    return stuck > MOST_STUCK * ticks


METRICS = placed(
    70,
    RunMetric(
        *("stuck_ticks", "stuck ticks"),
        short="stuck",
        needs=("status",),
        compute=lambda run: float(np.count_nonzero(run["status"] & STATUS_STUCK)),
        judged=Judged(limit=0.0),
    ),
    RunMetric(
        *("lag_ticks", "ticks with lag"),
        short="lag",
        needs=("status",),
        compute=lambda run: float(np.count_nonzero(run["status"] & STATUS_LAG)),
        judged=Judged(limit=0.0),
    ),
    RunMetric(
        *("no_place_ticks", "ticks without a place"),
        short="no place",
        unless_zero=True,
        needs=("status",),
        compute=lambda run: float(np.count_nonzero(run["status"] & STATUS_NO_PLACE)),
    ),
    RunMetric(
        *("lag_max", "lag, max", 2, "mm"),
        unless_zero=True,
        needs=("lag",),
        compute=lambda run: run["lag"].max(initial=0.0),
        judged=Judged(rounding=1e-9),
    ),
)
