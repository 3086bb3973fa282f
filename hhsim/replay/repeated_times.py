"""How far times differ from run to run of the same replay, of which nothing else does."""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary import ReplaySummary
from hhsim.replay.summary_table import SummaryRow


@dataclass(frozen=True)
class RepeatedTime:
    """One figure of time over several runs.

    Attributes:
        row: Its line in the table of the last run.
        mean: Over the runs [s], or [%] where it is defined so.
        deviation: Standard deviation of a run, n - 1 in the denominator, in the same unit.
    """

    row: SummaryRow
    mean: float
    deviation: float

    @property
    def shown(self) -> str:
        """Mean ± standard deviation as the table shows figures."""
        return f"{self.row.figure.shown(self.mean)} ± {self.row.figure.shown(self.deviation)}"


def repeated_times(runs: Sequence[ReplaySummary]) -> list[RepeatedTime]:
    """Every figure that has noise, over at least two runs of the same replay; what is undefined is left out."""
    found = []
    for row in runs[-1].rows:
        values = [float(other.value) for run in runs for other in run.rows if other.name == row.name]
        if run_metrics()[row.name].noise > 0.0 and all(map(math.isfinite, values)):
            found.append(RepeatedTime(row, statistics.mean(values), statistics.stdev(values)))
    return found
