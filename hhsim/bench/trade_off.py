"""What suites that set the time of a tick against its errors share: sums over runs, and who is beaten by nobody."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray, BoolArray, FloatArray, IntArray
from hhsim.bench.figure_fields import totals_of
from hhsim.bench.run_errors import check_finite, digest_of
from hhsim.errors import HhsimError
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import WORK_CANDIDATES, WORK_UNITS
from hhsim.table.file import ALL

GAIN = 0.05
"""Share by which the error of a slower configuration on the frontier is smaller."""


@dataclass
class Run:
    """One way to solve the hand on one scene."""

    object_name: str
    motion: str
    way: Any  # its configuration
    # CPU times of the ticks in contact [s], one array of shape (n,) a repetition; and other times of the same ticks.
    cpu: list[FloatArray] = field(default_factory=list)
    other: list[FloatArray] = field(default_factory=list)
    # Candidate pairs and work units of these ticks, shape (n,).
    candidates: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    work: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    errors: Any = None  # figures of the first repetition; None where it failed
    digest: str = ""  # of its poses and forces
    repeatable: bool = True  # True if all repetitions had the same digest
    ticks: int = 0  # ticks of a repetition
    seconds: float = 0.0  # CPU time of all ticks of the first repetition
    failure: str = ""  # message of the error that ended it, or ""

    def repeat(
        self,
        contact: BoolArray,
        play: Callable[[], TickRecord],
        errors: Callable[[TickRecord], Any],
        other: Callable[[TickRecord], AnyArray],
    ) -> None:
        """Play it once more, and take the times of the ticks in contact, `other` in [ns]; an HhsimError is kept."""
        try:
            record = play()
            check_finite(record)
            digest = digest_of(record)
            if self.errors is None:
                self.errors = errors(record)
                self.digest, self.ticks = digest, len(record.position)
                self.seconds = 1e-9 * float(record.duration_cpu.sum())
                self.candidates = record.work[contact, WORK_CANDIDATES]
                self.work = record.work[contact, WORK_UNITS]
        except HhsimError as error:
            self.failure = str(error)
            return
        self.repeatable = self.repeatable and digest == self.digest
        self.cpu.append(1e-9 * record.duration_cpu[contact].astype(np.float64))
        self.other.append(1e-9 * other(record)[contact].astype(np.float64))


def timed_row(object_name: str, motion: str, runs: Sequence[Run]) -> dict[str, Any]:
    """Return what every row has of runs of one way: names, times, figures and failures."""
    cpu, errors = tick_times([run.cpu for run in runs]), [run.errors for run in runs if run.errors is not None]
    return {
        "object": object_name,
        "motion": motion,
        "contact_ticks": cpu.size,
        "tick_cpu_p50": percentile(cpu, 50.0),
        "tick_cpu_p99": percentile(cpu, 99.0),
        "failed_runs": sum(bool(run.failure) for run in runs),
        **({} if not errors else totals_of(type(errors[0]), errors)),
    }


def mark_frontier(group: Sequence[dict[str, Any]], flag: str, error: str) -> None:
    """Mark the rows of a group that none beats in both time and error."""
    for i in frontier([row["tick_cpu_p50"] for row in group], [row[error] for row in group], GAIN):
        group[i][flag] = True


def groups_of(rows: Sequence[dict[str, Any]]) -> list[list[dict[str, Any]]]:
    """Return the rows that compete: of one object and motion, without failures."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = defaultdict(list)
    for row in rows:
        if not row["failed_runs"]:
            groups[row["object"], row["motion"]].append(row)
    return list(groups.values())


def summed_rows(
    runs: Sequence[Run], whole: Sequence[Run], row: Callable[[str, str, Sequence[Run]], dict[str, Any]]
) -> list[dict[str, Any]]:
    """Return a row a run, then one for each way and object of whole runs, then one for each way, of all runs."""
    groups: dict[tuple[str, Any], list[Any]] = defaultdict(list)
    for run in whole:
        groups[run.object_name, run.way].append(run)
    for run in runs:
        groups[ALL, run.way].append(run)
    rows = [row(run.object_name, run.motion, [run]) for run in runs]
    return rows + [row(name, ALL, group) for (name, _), group in groups.items()]


def failure_remark(runs: Sequence[Any], name: Callable[[Any], str]) -> list[str]:
    """Return a remark on the runs that failed, if any; `name` names the method of one."""
    failed = [run for run in runs if run.failure]
    where = [f"{name(run)}, {run.object_name}, {run.motion}: {run.failure}" for run in failed[:1]]
    return [f"{len(failed)} of {len(runs)} runs could not be done; the first: {first}" for first in where]


def tick_times(runs: Sequence[Sequence[FloatArray]]) -> FloatArray:
    """Return the times of the ticks of several runs, each the median of its repetitions, from those of all."""
    return np.concatenate([np.median(repetitions, axis=0) if repetitions else np.zeros(0) for repetitions in runs])


def percentile(values: AnyArray, percent: float) -> float:
    """Return a percentile of the ticks of a group of runs; NaN without any."""
    return float(np.percentile(values, percent)) if values.size else np.nan


def frontier(time: ArrayLike, error: ArrayLike, gain: float = 0.0) -> IntArray:
    """Return the indices of the points that no other point beats, by growing time.

    A point beats another if it is no worse in both and better in one. Of equal points the first counts; a point with a
    NaN is on no frontier. The error of a slower point is less by at least the share `gain`; 0 gives the plain frontier.
    """
    first, second = np.asarray(time, np.float64).ravel(), np.asarray(error, np.float64).ravel()
    order = np.lexsort((np.arange(first.size), second, first))
    order = order[~(np.isnan(first[order]) | np.isnan(second[order]))]
    if order.size == 0:
        return order
    kept = [int(order[0])]
    for index in order[1:]:
        best = second[kept[-1]]
        if second[index] < (best - gain * abs(best) if np.isfinite(best) else best):
            kept.append(int(index))
    return np.array(kept, np.int64)
