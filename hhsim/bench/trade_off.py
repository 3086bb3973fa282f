"""What suites that set the time of a tick against its errors share: sums over runs, and who is beaten by nobody."""

from collections import defaultdict
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.table.file import ALL

GAIN = 0.05
"""Share by which the error of a slower configuration on the frontier is smaller."""


def summed_rows(
    runs: Sequence[Any],
    whole: Sequence[Any],
    way: Callable[[Any], Any],
    row: Callable[[str, str, Sequence[Any]], dict[str, Any]],
) -> list[dict[str, Any]]:
    """Return a row a run, then one for each way and object of whole runs, then one for each way, of all runs."""
    groups: dict[tuple[str, Any], list[Any]] = defaultdict(list)
    for run in whole:
        groups[run.object_name, way(run)].append(run)
    for run in runs:
        groups[ALL, way(run)].append(run)
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
