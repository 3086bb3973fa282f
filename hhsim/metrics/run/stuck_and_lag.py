"""Ticks that did not get to where the user asked."""

import numpy as np

from hhsim.kernels.tick.state import STATUS_LAG, STATUS_STUCK
from hhsim.metrics.run_metric import Judged, RunMetric

MOST_STUCK = 0.5
"""Share of stuck ticks above which the figures of a run are of a hand that did not follow."""


def is_mostly_stuck(stuck: float, ticks: int) -> bool:
    """Return whether more than half of the ticks are stuck: such a run misses its limits, whatever these are."""
    return stuck > MOST_STUCK * ticks


METRICS = (
    RunMetric(
        name="stuck_ticks",
        label="stuck ticks",
        place=70,
        short="stuck",
        needs=("status",),
        compute=lambda run: float(np.count_nonzero(run["status"] & STATUS_STUCK)),
        judged=Judged(limit=0.0),
    ),
    RunMetric(
        name="lag_ticks",
        label="ticks with lag",
        place=71,
        short="lag",
        needs=("status",),
        compute=lambda run: float(np.count_nonzero(run["status"] & STATUS_LAG)),
        judged=Judged(limit=0.0),
    ),
    RunMetric(
        name="lag_max",
        label="lag, max",
        digits=2,
        unit="mm",
        place=72,
        unless_zero=True,
        needs=("lag",),
        compute=lambda run: run["lag"].max(initial=0.0),
        judged=Judged(rounding=1e-9),
    ),
)
