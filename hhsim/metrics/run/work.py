"""What the scene modelled, and how much of it a tick had to look at."""

import math

from hhsim.arrays import AnyArray
from hhsim.metrics.run_metric import RunMetric
from hhsim.metrics.run_ticks import RunTicks

NODES, PAIRS = "work/node_tests", "work/pair_tests"


def _mean(values: AnyArray) -> float:
    return float(values.mean()) if values.size else math.nan


def _tests(run: RunTicks) -> float:
    return _mean(run[NODES] + run[PAIRS])


METRICS = (
    RunMetric(
        name="fingers_modelled",
        label="fingers modelled, of 5",
        less_is_better=False,
        place=60,
        compute=lambda run: run.fingers,
    ),
    RunMetric(
        name="bodies_near",
        label="bodies near the object in contact, of 16",
        digits=1,
        less_is_better=False,
        place=61,
        needs=("work/bodies", "contacts/candidates"),
        compute=lambda run: _mean(run["work/bodies"][run.contact]),
    ),
    RunMetric(
        name="rows_max",
        label="contacts in a program, most",
        less_is_better=False,
        place=62,
        needs=("work/rows",),
        compute=lambda run: run["work/rows"].max(initial=0),
    ),
    RunMetric(
        name="tests_mean",
        label="distances computed a tick, mean",
        place=63,
        needs=(NODES, PAIRS),
        compute=_tests,
    ),
    RunMetric(
        name="tests_share",
        label="share of all pairs of body and sphere",
        digits=3,
        unit="%",
        place=64,
        needs=(NODES, PAIRS),
        compute=lambda run: 100.0 * _tests(run) / run.all_pairs if run.all_pairs else math.nan,
    ),
    RunMetric(
        name="work_mean",
        label="work a tick, mean",
        unit="units",
        place=65,
        needs=("work/units",),
        compute=lambda run: _mean(run["work/units"]),
    ),
)
