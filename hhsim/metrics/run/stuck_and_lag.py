"""Ticks that did not reach the user's hand."""

from typing import Any

import numpy as np

from hhsim.kernels.tick.state import STATUS_LAG, STATUS_NO_PLACE, STATUS_SNAP, STATUS_STUCK
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import RunTicks

MOST_STUCK = 0.5
"""Largest share of stuck ticks of a run whose hand follows."""


def is_mostly_stuck(stuck: float, ticks: int) -> bool:
    """True if more than half of the ticks are stuck: such a run misses its limits."""
    return stuck > MOST_STUCK * ticks


def _flagged(name: str, label: str, flag: int, **more: Any) -> RunMetric:
    """Figure of the number of ticks whose status has a flag."""

    def compute(run: RunTicks) -> float:
        return float(np.count_nonzero(run["status"] & flag))

    return RunMetric(name, label, needs=("status",), compute=compute, **more)


METRICS = (
    _flagged("stuck_ticks", "stuck ticks", STATUS_STUCK, short="stuck", judged=Judged(limit=0.0)),
    _flagged("lag_ticks", "ticks with lag", STATUS_LAG, short="lag", judged=Judged(limit=0.0)),
    _flagged("snap_ticks", "ticks that snap", STATUS_SNAP, short="snaps", unless_zero=True),
    _flagged("no_place_ticks", "ticks without a place", STATUS_NO_PLACE, short="no place", unless_zero=True),
    RunMetric(
        "lag_max", "lag, max", digits=2, unit="mm", unless_zero=True, needs=("lag", "status"),
        # A hand that snaps has a way left, and no lag.
        compute=lambda run: run["lag"][run["status"] & STATUS_SNAP == 0].max(initial=0.0), judged=Judged(rounding=1e-9),
    ),
)  # fmt: skip
