"""Size of the modelled scene, and the work of a tick."""

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
