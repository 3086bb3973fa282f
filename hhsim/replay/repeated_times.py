"""Spread of the times over several runs of the same replay, which differ in nothing else."""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from hhsim.metrics.run.registry import run_metrics
from hhsim.replay.summary import ReplaySummary
from hhsim.replay.summary_table import SummaryRow

MORE_DIGITS = 2
"""Digits that a deviation may add to the table's tenths of a µs: a tick's time is whole nanoseconds."""


@dataclass(frozen=True)
class RepeatedTime:
    """Mean and standard deviation (n - 1) of a figure of time over several runs, and its row in the last table."""

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
    """Return the number of decimals that show two digits of a deviation, at least `digits` and not many more."""
    if not deviation > 0.0:
        return digits
    return min(max(digits, 1 - math.floor(math.log10(deviation))), digits + MORE_DIGITS)


def repeated_times(runs: Sequence[ReplaySummary]) -> list[RepeatedTime]:
    """Return every figure that has noise, over at least two runs of the same replay, without undefined ones."""
    found = []
    for row in runs[-1].rows:
        values = [float(other.value) for run in runs for other in run.rows if other.name == row.name]
        if run_metrics()[row.name].noise > 0.0 and all(map(math.isfinite, values)):
            found.append(RepeatedTime(row, statistics.mean(values), statistics.stdev(values)))
    return found


def repeated_document(runs: Sequence[ReplaySummary]) -> dict[str, Any]:
    """Return times over at least two runs of the same replay as plain values: SI, or % where defined so."""
    times = {time.row.name: {"mean": time.mean, "std": time.deviation} for time in repeated_times(runs)}
    return {"runs": len(runs), "times": times}


def stored_times(repeated: Mapping[str, Any], rows: Sequence[SummaryRow]) -> list[RepeatedTime]:
    """Return the repeated times of a result (`hhsim.result.reader.Result.repeated`), in the order of its table."""
    times = repeated.get("times", {})
    return [RepeatedTime(row, times[row.name]["mean"], times[row.name]["std"]) for row in rows if row.name in times]
