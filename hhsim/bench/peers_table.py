"""The table of `hhsim bench peers`: every run, and every method over its motions and objects."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from hhsim.bench.peers import Peer, PeerErrors, PeerRun
from hhsim.bench.speed_error_table import ALL, GAIN, frontier, joined, percentile
from hhsim.bench.table import metric_column
from hhsim.metrics import metrics
from hhsim.table.table import Column

Row = dict[str, Any]

MEANS = ("contact_error_mean", "palm_off_mean", "force_hold", "force_variation_hold", "force_variation_tremor")
"""A row that sums up has their mean, the sum of the samples, and the worst of all others."""

COLUMNS: tuple[Column, ...] = (
    Column("object", "object; 'all' sums up"),
    Column("motion", "motion; 'all' sums up"),
    Column("method", "method"),
    Column("surface", "surface that a method of ours touches; an engine makes its own, and is judged on the mesh"),
    Column("ours", "whether it is a method of hhsim's own"),
    Column("contact_ticks", "ticks with the haptic hand within 1 mm of the mesh or inside; times are of these"),
    Column("repetitions", "repetitions that the times are the median of; where a row sums up, the fewest"),
    Column("tick_cpu_p50", "CPU time of a tick in contact, the call from Python included, median", "s"),
    Column("tick_cpu_p99", "CPU time of a tick in contact, the call from Python included, 99th percentile", "s"),
    Column("native_cpu_p50", "CPU time of the engine's own step alone in such a tick, median", "s"),
    Column("native_cpu_p99", "CPU time of the engine's own step alone in such a tick, 99th percentile", "s"),
    Column("mesh_depth_max", "deepest penetration of the true mesh by coal, at `samples` ticks", "m"),
    Column("mesh_depth_p95", "95th percentile of the penetration of the true mesh by coal, at `samples` ticks", "m"),
    Column("contact_error_mean", "distance from the true mesh of bodies that are pushed, mean", "m"),
    Column("contact_error_max", "distance from the true mesh of bodies that are pushed, largest", "m"),
    Column("mesh_error", "the larger of mesh_depth_max and contact_error_max", "m"),
    Column("palm_off_mean", "distance of the shown palm from the user's in contact, mean", "m"),
    Column("palm_lag_max", "distance of the shown palm from the user's where nothing touches, largest", "m"),
    metric_column("force_hold_mean", "force_hold"),
    metric_column("force_variation_hold"),
    metric_column("force_variation_tremor"),
    metric_column("force_step"),
    Column("force_step_newton", "largest one-tick change of the total force while moving", "N"),
    Column("samples", "ticks at which the hand was held against the true mesh"),
    Column("failed_runs", "runs that could not be done; their figures are missing"),
    Column("frontier", "whether no other method is both faster and nearer to the mesh: tick_cpu_p50 and mesh_error"),
    Column(
        "times_ours", "tick_cpu_p50 over that of our fastest method whose mesh_error is no larger; NaN: there is none"
    ),
)


def table_rows(runs: Sequence[PeerRun]) -> list[Row]:
    """One row a run; then one for each method and object, and one for each method over all objects."""
    rows = [_row(run.object_name, run.motion, run.peer, [run]) for run in runs]
    by_object: dict[tuple[str, Peer], list[PeerRun]] = defaultdict(list)
    by_peer: dict[Peer, list[PeerRun]] = defaultdict(list)
    for run in runs:
        by_object[run.object_name, run.peer].append(run)
        by_peer[run.peer].append(run)
    rows += [_row(name, ALL, peer, group) for (name, peer), group in by_object.items()]
    rows += [_row(ALL, ALL, peer, group) for peer, group in by_peer.items()]
    _set_side_by_side(rows)
    return rows


def remarks(runs: Sequence[PeerRun]) -> list[str]:
    """What a reader should know besides, a sentence each."""
    found = [
        "every method has the same hand, its phalanges capsules; no contact has friction",
        "times are CPU times of ticks with the haptic hand within 1 mm of the mesh, the median of the repetitions; "
        "compare them within this run, not between machines",
        "a body's distance from the mesh is coal's; off the mesh is a body that the method says is pushed by 0.01 N "
        "and more",
    ]
    failed = [run for run in runs if run.failure]
    if failed:
        first = failed[0]
        where = f"{first.peer.method}, {first.object_name}, {first.motion}"
        found.append(f"{len(failed)} of {len(runs)} runs could not be done; the first: {where}: {first.failure}")
    return found


def won_by_others(rows: Sequence[Row]) -> list[Row]:
    """Rows of single scenes in which an engine is as near to the mesh as it is faster than all of ours that are."""
    return [row for row in rows if ALL not in (row["object"], row["motion"]) and not row["ours"] and _beats(row)]


def _beats(row: Row) -> bool:
    # None of ours is as good, or the one that is takes longer.
    return not row["failed_runs"] and not row["times_ours"] >= 1.0 and not np.isnan(row["mesh_error"])


def _row(object_name: str, motion: str, peer: Peer, runs: Sequence[PeerRun]) -> Row:
    cpu, native = (joined([getattr(run, kind) for run in runs]) for kind in ("tick_cpu", "tick_native"))
    errors = [run.errors for run in runs if run.errors is not None]
    return {
        "object": object_name,
        "motion": motion,
        "method": peer.method,
        "surface": peer.surface if peer.ours else "its own",
        "ours": peer.ours,
        "contact_ticks": cpu.size,
        "repetitions": min(len(run.cpu) for run in runs),
        "tick_cpu_p50": percentile(cpu, 50.0),
        "tick_cpu_p99": percentile(cpu, 99.0),
        "native_cpu_p50": percentile(native, 50.0),
        "native_cpu_p99": percentile(native, 99.0),
        **{
            item.name: _summed_up(item.name, [getattr(error, item.name) for error in errors])
            for item in fields(PeerErrors)
        },
        "failed_runs": sum(bool(run.failure) for run in runs),
        "frontier": False,
        "times_ours": np.nan,
    }


def _summed_up(name: str, values: Sequence[float]) -> float | int:
    if name == "samples":
        return int(sum(values))
    found = metrics.statistics(values)
    return found.mean if name in MEANS else found.max


def _set_side_by_side(rows: Sequence[Row]) -> None:
    groups = defaultdict(list)
    for row in rows:
        if not row["failed_runs"]:
            groups[row["object"], row["motion"]].append(row)
    for group in groups.values():
        for i in frontier([row["tick_cpu_p50"] for row in group], [row["mesh_error"] for row in group], GAIN):
            group[i]["frontier"] = True
        for row in group:
            as_good = [one["tick_cpu_p50"] for one in group if one["ours"] and one["mesh_error"] <= row["mesh_error"]]
            if as_good:
                row["times_ours"] = row["tick_cpu_p50"] / min(as_good)
