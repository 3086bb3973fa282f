"""How long ticks take: those in contact, which free space would flatter, and the slowest of all."""

import math

from hhsim.metrics.metrics import TickStatistics, tick_statistics
from hhsim.metrics.run_metric import RunMetric
from hhsim.metrics.run_ticks import RunTicks

CPU, WALL, CONTACT = "duration/total_cpu", "duration/total", "contacts/candidates"


def _in_contact(run: RunTicks, column: str) -> TickStatistics:
    return tick_statistics(run[column][run.contact])


METRICS = (
    RunMetric(
        name="tick_cpu_p50",
        label="tick in contact, CPU, p50",
        digits=1,
        unit="µs",
        scale=1e-6,
        paper="310 to ≈ 1,000",
        place=20,
        needs=(CPU, CONTACT),
        compute=lambda run: 1e-6 * _in_contact(run, CPU).p50,
        # Identical code differs by several percent from process to process in the median, by tens of percent at p99.
        noise=0.10,
    ),
    RunMetric(
        name="tick_cpu_p99",
        label="tick in contact, CPU, p99",
        digits=1,
        unit="µs",
        scale=1e-6,
        paper="< 1,500",
        place=21,
        needs=(CPU, CONTACT),
        compute=lambda run: 1e-6 * _in_contact(run, CPU).p99,
        noise=0.50,
    ),
    RunMetric(
        name="tick_cpu_max",
        label="tick, CPU, max",
        digits=1,
        unit="µs",
        scale=1e-6,
        paper="< 1,500",
        place=22,
        needs=(CPU,),
        compute=lambda run: 1e-6 * tick_statistics(run[CPU]).max,
        noise=math.inf,
    ),
    RunMetric(
        name="tick_wall_p50",
        label="tick in contact, wall, p50",
        digits=1,
        unit="µs",
        scale=1e-6,
        place=23,
        needs=(WALL, CONTACT),
        compute=lambda run: 1e-6 * _in_contact(run, WALL).p50,
        noise=0.10,
    ),
    RunMetric(
        name="tick_wall_over_1ms",
        label="ticks over 1 ms, wall",
        digits=2,
        unit="%",
        place=24,
        needs=(WALL,),
        compute=lambda run: 100.0 * tick_statistics(run[WALL]).over_budget,
        noise=math.inf,
    ),
)
