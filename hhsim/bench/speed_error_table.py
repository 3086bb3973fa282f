"""Table of `hhsim bench speed-error`: every run, and every configuration over its motions and objects."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray, FloatArray, IntArray
from hhsim.bench.run_errors import RunErrors
from hhsim.bench.speed_error import NO_LEVEL, Run
from hhsim.bench.table import columns_of, metric_column, totals_of
from hhsim.solver.qp import ACTIVE_SET
from hhsim.table.table import Column

Row = dict[str, Any]

ALL = "all"
"""Object or motion of a row that sums up."""

GAIN = 0.05
"""Share by which the error of a slower configuration on the frontier is smaller."""

COLUMNS: tuple[Column, ...] = (
    Column("object", "object; 'all' sums up"),
    Column("motion", "motion; 'all' sums up"),
    Column("method", "method of the solver"),
    Column("surface", "what of the object the hand touches: the leaf spheres of its tree, or the mesh itself"),
    Column("level", f"level of the sphere tree; {NO_LEVEL} on the mesh, which has none"),
    Column("linearisations", "most linearisations in a tick"),
    Column("qp", "QP solver"),
    Column("stretch", "whether only a stretch of the motion was run, to set QP solvers side by side"),
    Column("is_default", "whether this is the method as it comes"),
    Column("ticks", "ticks that were run, each repetition"),
    Column("contact_ticks", "ticks with the haptic hand within 1 mm of the object or inside; times are of these"),
    metric_column("candidates_max"),
    Column("tick_cpu_p50", "CPU time of a tick in contact, median", "s"),
    Column("tick_cpu_p99", "CPU time of a tick in contact, 99th percentile", "s"),
    Column("tick_cpu_max", "CPU time of a tick in contact, most", "s"),
    Column("tick_wall_p50", "wall time of a tick in contact, median", "s"),
    Column("tick_wall_p99", "wall time of a tick in contact, 99th percentile", "s"),
    Column("over_1ms", "share of ticks in contact over 1 ms, CPU"),
    Column("work_p50", "work units of a tick in contact, median: the same on any machine; NaN for a method without"),
    *columns_of(RunErrors),
    Column("repeatable", "whether every repetition gave the same poses and forces"),
    Column("failed_runs", "runs that could not be done; their figures are missing, and they are on no frontier"),
    Column("mesh_frontier", "whether no configuration is both faster and nearer to the mesh: p50 and mesh_error"),
    Column("tracking_frontier", "whether none is both faster and nearer to the optimum: p50 and off_optimum_mean"),
)


def table_rows(runs: Sequence[Run]) -> list[Row]:
    """Return a row a run, then one for each configuration and object, then one for each configuration.

    Runs of a stretch are summed up over all objects only.
    """
    whole = [run for run in runs if not run.configuration.stretch]
    rows = summed_rows(runs, whole, attrgetter("configuration"), _row)
    groups = defaultdict(list)
    for row in rows:
        if not row["stretch"] and not row["failed_runs"]:
            groups[row["object"], row["motion"]].append(row)
    for group in groups.values():
        for flag, error in (("mesh_frontier", "mesh_error"), ("tracking_frontier", "off_optimum_mean")):
            for i in frontier([row["tick_cpu_p50"] for row in group], [row[error] for row in group], GAIN):
                group[i][flag] = True
    return rows


def summed_rows(
    runs: Sequence[Any], whole: Sequence[Any], way: Callable[[Any], Any], row: Callable[[str, str, Sequence[Any]], Row]
) -> list[Row]:
    """Return a row a run, then one for each way and object of whole runs, then one for each way, of all runs."""
    groups: dict[tuple[str, Any], list[Any]] = defaultdict(list)
    for run in whole:
        groups[run.object_name, way(run)].append(run)
    for run in runs:
        groups[ALL, way(run)].append(run)
    rows = [row(run.object_name, run.motion, [run]) for run in runs]
    return rows + [row(name, ALL, group) for (name, _), group in groups.items()]


def chosen(rows: Iterable[Row], *, stretch: bool = False, **values: Any) -> list[Row]:
    """Return the rows of whole motions, or of stretches, that have these values, such as object="all"."""
    return [row for row in rows if row["stretch"] == stretch and all(row[name] == v for name, v in values.items())]


def touched(surface: str, level: int) -> str:
    """Return the surface and level in words."""
    return f"level {level}" if surface == "spheres" else surface


def remarks(runs: Sequence[Run]) -> list[str]:
    """Return remarks on the table, a sentence each."""
    measured = [(run, run.errors) for run in runs if run.errors is not None]
    ticks = sum(run.candidates.size for run, _ in measured)
    points = sum(errors.contact_points for _, errors in measured)
    samples = sum(errors.samples for _, errors in measured)
    found = [
        f"distances from the true mesh are of all {points:,} contact points, those of one place once, and of the "
        f"hand at {samples:,} ticks, of {ticks:,} in contact; how deep it is in what it touches is that of every "
        "tick",
        "the best pose is that of least coupling energy outside the mesh itself, whatever a configuration touches",
        "times are of the ticks with the haptic hand within 1 mm of the object, the median of the repetitions; compare "
        "them within this run, not between machines",
    ]
    changing = [run.configuration for run in runs if not run.repeatable]
    different = sorted({one.method if one.qp == ACTIVE_SET else f"{one.method} with {one.qp}" for one in changing})
    if different:
        found.append(f"the poses of {', '.join(different)} differ between repetitions: they are not deterministic")

    def named(run: Run) -> str:
        return f"{run.configuration.method}, {touched(run.configuration.surface, run.configuration.level)}"

    return [*found, *failure_remark(runs, named)]


def failure_remark(runs: Sequence[Any], name: Callable[[Any], str]) -> list[str]:
    """Return a remark on the runs that failed, if any; `name` names the method of one."""
    failed = [run for run in runs if run.failure]
    where = [f"{name(run)}, {run.object_name}, {run.motion}: {run.failure}" for run in failed[:1]]
    return [f"{len(failed)} of {len(runs)} runs could not be done; the first: {first}" for first in where]


def _row(object_name: str, motion: str, runs: Sequence[Run]) -> Row:
    configuration = runs[0].configuration
    cpu, wall = tick_times([run.cpu for run in runs]), tick_times([run.wall for run in runs])
    candidates, work = (np.concatenate([getattr(run, kind) for run in runs]) for kind in ("candidates", "work"))
    errors = [run.errors for run in runs if run.errors is not None]
    return {
        "object": object_name,
        "motion": motion,
        **asdict(configuration),
        "is_default": configuration.is_default and configuration.qp == ACTIVE_SET,
        "ticks": sum(run.ticks for run in runs),
        "contact_ticks": cpu.size,
        "candidates_max": int(candidates.max(initial=0)),
        "tick_cpu_p50": percentile(cpu, 50.0),
        "tick_cpu_p99": percentile(cpu, 99.0),
        "tick_cpu_max": percentile(cpu, 100.0),
        "tick_wall_p50": percentile(wall, 50.0),
        "tick_wall_p99": percentile(wall, 99.0),
        "over_1ms": float(np.mean(cpu > 1e-3)) if cpu.size else np.nan,
        "work_p50": percentile(work, 50.0) if work.any() else np.nan,
        **totals_of(RunErrors, errors),
        "repeatable": all(run.repeatable for run in runs),
        "failed_runs": sum(bool(run.failure) for run in runs),
        "mesh_frontier": False,
        "tracking_frontier": False,
    }


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
