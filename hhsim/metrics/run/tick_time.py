"""Times of ticks: those in contact, and the slowest of all."""

import math

from hhsim.metrics.metrics import tick_statistics
from hhsim.metrics.run_metric import RunMetric
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


METRICS = (
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
