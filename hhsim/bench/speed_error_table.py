"""The table of `hhsim bench speed-error`: every run, and every configuration over its motions and objects."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import AnyArray, IntArray
from hhsim.bench.run_errors import RunErrors
from hhsim.bench.speed_error import NO_LEVEL, Configuration, Run
from hhsim.bench.table import metric_column
from hhsim.metrics import metrics
from hhsim.solver.qp import ACTIVE_SET
from hhsim.table.table import Column

Row = dict[str, Any]

ALL = "all"
"""Stands for every object or motion in a row that sums up."""

GAIN = 0.05
"""A slower configuration is on the frontier if it is nearer by more than this share."""

WORST = (
    *("penetration_max", "mesh_depth_max", "contact_error_max", "mesh_error", "off_optimum_max", "force_ripple"),
    *("force_step", "posture_jump_max", "lag_max"),
)
COUNTED = ("stuck_ticks", "lag_ticks", "contact_points", "samples")
"""A row that sums up has the worst of the first, the sum of the second and the mean of all others."""

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
    metric_column("penetration_max"),
    Column("mesh_depth_max", "deepest penetration of the true mesh by coal, at `samples` ticks", "m"),
    Column("mesh_depth_p95", "95th percentile of the penetration of the true mesh by coal, at `samples` ticks", "m"),
    Column("contact_error_mean", "mean distance of contact points from the true mesh by coal, all ticks", "m"),
    Column("contact_error_max", "largest distance of contact points from the true mesh by coal, all ticks", "m"),
    Column("mesh_error", "the larger of mesh_depth_max and contact_error_max", "m"),
    Column("tracking_excess", "coupling energy over the optimum on the same surface, mean of the hold, (E - E*) / E*"),
    Column("off_optimum_mean", "farthest of palm and fingertips from the converged optimum on the mesh, mean", "m"),
    Column("off_optimum_max", "farthest of palm and fingertips from the converged optimum on the mesh, most", "m"),
    metric_column("force_hold_mean", "force_hold"),
    metric_column("force_variation_hold"),
    metric_column("force_variation_tremor"),
    metric_column("force_ripple_hold", "force_ripple"),
    metric_column("force_step"),
    Column("posture_jump_max", "farthest that the graphic hand moved in a tick beyond the haptic hand", "m"),
    *(metric_column(name) for name in ("stuck_ticks", "lag_ticks", "lag_max")),
    Column("contact_points", "contact points whose distance from the true mesh was measured, those of one place once"),
    Column("samples", "ticks at which the depth in the true mesh was measured"),
    Column("repeatable", "whether every repetition gave the same poses and forces"),
    Column("failed_runs", "runs that could not be done; their figures are missing, and they are on no frontier"),
    Column("mesh_frontier", "whether no configuration is both faster and nearer to the mesh: p50 and mesh_error"),
    Column("tracking_frontier", "whether none is both faster and nearer to the optimum: p50 and off_optimum_mean"),
)


def table_rows(runs: Sequence[Run]) -> list[Row]:
    """One row a run; then one for each configuration and object, and one for each configuration over all objects.

    Rows of a stretch are summed up over all objects only.
    """
    rows = [_row(run.object_name, run.motion, run.configuration, [run]) for run in runs]
    by_object: dict[tuple[str, Configuration], list[Run]] = defaultdict(list)
    by_configuration: dict[Configuration, list[Run]] = defaultdict(list)
    for run in runs:
        if not run.configuration.stretch:
            by_object[run.object_name, run.configuration].append(run)
        by_configuration[run.configuration].append(run)
    rows += [_row(name, ALL, configuration, group) for (name, configuration), group in by_object.items()]
    rows += [_row(ALL, ALL, configuration, group) for configuration, group in by_configuration.items()]
    _mark_frontiers(rows)
    return rows


def chosen(rows: Iterable[Row], *, stretch: bool = False, **values: Any) -> list[Row]:
    """The rows of whole motions, or of stretches, that have these values; such as object="all", motion="all"."""
    return [row for row in rows if row["stretch"] == stretch and all(row[name] == v for name, v in values.items())]


def touched(surface: str, level: int) -> str:
    """What of the object is touched, in words."""
    return f"level {level}" if surface == "spheres" else surface


def remarks(runs: Sequence[Run]) -> list[str]:
    """What a reader should know besides, a sentence each."""
    ticks = sum(run.tick_cpu.size for run in runs if run.errors is not None)
    points = sum(run.errors.contact_points for run in runs if run.errors is not None)
    samples = sum(run.errors.samples for run in runs if run.errors is not None)
    found = [
        f"distances from the true mesh are coal's: of all {points:,} contact points, those of one place once, and of "
        f"the hand at {samples:,} ticks, of {ticks:,} in contact; how deep it is in what it touches is that of every "
        "tick",
        "the best pose is that of least coupling energy outside the mesh itself, whatever a configuration touches",
        "times are of the ticks with the haptic hand within 1 mm of the object, the median of the repetitions; compare "
        "them within this run, not between machines",
    ]
    changing = [run.configuration for run in runs if not run.repeatable]
    different = sorted({one.method if one.qp == ACTIVE_SET else f"{one.method} with {one.qp}" for one in changing})
    if different:
        found.append(f"the poses of {', '.join(different)} differ between repetitions: they are not deterministic")
    failed = [run for run in runs if run.failure]
    if failed:
        first = failed[0]
        how = f"{first.configuration.method}, {touched(first.configuration.surface, first.configuration.level)}"
        where = f"{how}, {first.object_name}, {first.motion}"
        found.append(f"{len(failed)} of {len(runs)} runs could not be done; the first: {where}: {first.failure}")
    return found


def _row(object_name: str, motion: str, configuration: Configuration, runs: Sequence[Run]) -> Row:
    cpu, wall = (joined([getattr(run, kind) for run in runs]) for kind in ("tick_cpu", "tick_wall"))
    candidates = joined([run.candidates for run in runs])
    work = joined([run.work for run in runs])
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
        **{
            item.name: _summed_up(item.name, [getattr(error, item.name) for error in errors])
            for item in fields(RunErrors)
        },
        "repeatable": all(run.repeatable for run in runs),
        "failed_runs": sum(bool(run.failure) for run in runs),
        "mesh_frontier": False,
        "tracking_frontier": False,
    }


def _summed_up(name: str, values: Sequence[float]) -> float | int:
    if name in COUNTED:
        return int(sum(values))
    found = metrics.statistics(values)
    return found.max if name in WORST else found.mean


def joined(parts: Sequence[AnyArray]) -> AnyArray:
    """The ticks of several runs in one array; empty where there is no run."""
    return np.concatenate(parts) if parts else np.zeros(0)


def percentile(values: AnyArray, percent: float) -> float:
    """Of the ticks of a group of runs; NaN where there are none."""
    return float(np.percentile(values, percent)) if values.size else np.nan


def frontier(time: ArrayLike, error: ArrayLike, gain: float = 0.0) -> IntArray:
    """Indices of the points that no other point beats, by growing time.

    A point beats another if it is no worse in both and better in one. Of equal points the first counts; a point with a
    NaN is on no frontier.

    Args:
        time: Shape (n,); less is better.
        error: Shape (n,); less is better.
        gain: A slower point counts only if its error is smaller than that of the frontier before it by more than this
            share of it, so that a hair's breadth earns no place; 0 gives the plain frontier.
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


def _mark_frontiers(rows: Sequence[Row]) -> None:
    groups = defaultdict(list)
    for row in rows:
        if not row["stretch"] and not row["failed_runs"]:
            groups[row["object"], row["motion"]].append(row)
    for group in groups.values():
        for flag, error in (("mesh_frontier", "mesh_error"), ("tracking_frontier", "off_optimum_mean")):
            for i in frontier([row["tick_cpu_p50"] for row in group], [row[error] for row in group], GAIN):
                group[i][flag] = True
