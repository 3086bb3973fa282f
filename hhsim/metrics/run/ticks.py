"""Times of ticks, their work, and those that did not reach the user's hand."""

import math
from typing import Any

import numpy as np

from hhsim.arrays import AnyArray
from hhsim.kernels.tick.state import STATUS_LAG, STATUS_NO_PLACE, STATUS_SNAP, STATUS_STUCK
from hhsim.metrics.metrics import tick_statistics
from hhsim.metrics.run_metric import Judged, RunMetric
from hhsim.metrics.run_ticks import RunTicks

CPU, WALL, CONTACT = "duration/total_cpu", "duration/total", "contacts/candidates"


def _time(
    name: str, label: str, column: str, statistic: str, noise: float, paper: str = "", short: str = ""
) -> RunMetric:
    """Figure of tick times, one of `TickStatistics`: of the ticks in contact, but for the slowest of all."""

    def compute(run: RunTicks) -> float:
        ticks = run[column] if statistic == "max" else run[column][run.contact]
        return 1e-6 * float(getattr(tick_statistics(ticks), statistic))

    needs = (column,) if statistic == "max" else (column, CONTACT)
    return RunMetric(name, label, 1, "µs", paper=paper, needs=needs, compute=compute, noise=noise, short=short)


_TIMES = (
    # Identical code differs by several percent from process to process in the median, by tens of percent at p99.
    _time("tick_cpu_p50", "tick in contact, CPU, p50", CPU, "p50", 0.10, short="p50"),
    _time("tick_cpu_p99", "tick in contact, CPU, p99", CPU, "p99", 0.50, short="p99"),
    _time("tick_cpu_max", "tick, CPU, max", CPU, "max", math.inf, "Fig. 14: < 1,500"),
    _time("tick_wall_p50", "tick in contact, wall, p50", WALL, "p50", 0.10),
    RunMetric(
        "tick_wall_over_1ms", "ticks over 1 ms, wall", digits=2, unit="%", needs=(WALL,),
        compute=lambda run: 100.0 * tick_statistics(run[WALL]).over_budget, noise=math.inf,
    ),
)  # fmt: skip


NODES, PAIRS = "work/node_tests", "work/pair_tests"


def _mean(values: AnyArray) -> float:
    return float(values.mean()) if values.size else math.nan


def _tests(run: RunTicks) -> float:
    return _mean(run[NODES] + run[PAIRS])


_WORK = (
    RunMetric("fingers_modelled", "fingers modelled, of 5", less_is_better=False, compute=lambda run: run.fingers),
    RunMetric(
        "bodies_near", "bodies near the object in contact, of 16", digits=1, less_is_better=False,
        needs=("work/bodies", "contacts/candidates"), compute=lambda run: _mean(run["work/bodies"][run.contact]),
    ),
    RunMetric(
        "rows_max", "contacts in a program, most", less_is_better=False, needs=("work/rows",),
        compute=lambda run: run["work/rows"].max(initial=0),
    ),
    RunMetric("tests_mean", "distances computed a tick, mean", needs=(NODES, PAIRS), compute=_tests),
    RunMetric(
        "tests_share", "share of all pairs of body and sphere", digits=3, unit="%", needs=(NODES, PAIRS),
        compute=lambda run: 100.0 * _tests(run) / run.all_pairs if run.all_pairs else math.nan,
    ),
    RunMetric(
        "work_mean", "work a tick, mean", unit="units", needs=("work/units",),
        compute=lambda run: _mean(run["work/units"]),
    ),
)  # fmt: skip


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


_FLAGS = (
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

METRICS = (*_TIMES, *_WORK, *_FLAGS)
