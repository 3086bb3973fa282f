"""How far times differ from run to run of the same replay, of which nothing else does."""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary import ReplaySummary
from hhsim.replay.summary_table import SummaryRow

MORE_DIGITS = 2
"""That a deviation may add to those of the table, which are tenths of a µs: a tick's time is whole nanoseconds."""


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
        """Mean ± standard deviation in the table's unit, with digits enough for two of the deviation."""
        figure = self.row.figure
        figure = replace(figure, digits=digits_with(self.deviation / figure.scale, figure.digits))
        return f"{figure.shown(self.mean)} ± {figure.shown(self.deviation)}"


def digits_with(deviation: float, digits: int) -> int:
    """Digits behind the point that show two of a deviation, at least `digits` and not many more."""
    if not deviation > 0.0:
        return digits
    return min(max(digits, 1 - math.floor(math.log10(deviation))), digits + MORE_DIGITS)


def repeated_times(runs: Sequence[ReplaySummary]) -> list[RepeatedTime]:
    """Every figure that has noise, over at least two runs of the same replay; what is undefined is left out."""
    found = []
    for row in runs[-1].rows:
        values = [float(other.value) for run in runs for other in run.rows if other.name == row.name]
        if run_metrics()[row.name].noise > 0.0 and all(map(math.isfinite, values)):
            found.append(RepeatedTime(row, statistics.mean(values), statistics.stdev(values)))
    return found


def repeated_document(runs: Sequence[ReplaySummary]) -> dict[str, Any]:
    """Times over at least two runs of the same replay, for machines and for the file: SI, or % where defined so."""
    times = {time.row.name: {"mean": time.mean, "std": time.deviation} for time in repeated_times(runs)}
    return {"runs": len(runs), "times": times}


def stored_times(repeated: Mapping[str, Any], rows: Sequence[SummaryRow]) -> list[RepeatedTime]:
    """What a result says of its runs, in the order of its table; nothing where it was run once.

    Args:
        repeated: `hhsim.result.reader.Result.repeated`.
    """
    times = repeated.get("times", {})
    return [RepeatedTime(row, times[row.name]["mean"], times[row.name]["std"]) for row in rows if row.name in times]
