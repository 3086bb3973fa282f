"""Table of `hhsim bench peers`: every run, and every method over its motions and objects."""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from hhsim.bench.figure_columns import columns_of, totals_of
from hhsim.bench.peers import Peer, PeerErrors, PeerRun
from hhsim.bench.speed_error_table import ALL, GAIN, failure_remark, frontier, joined, percentile
from hhsim.table.table import Column

Row = dict[str, Any]

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
    *columns_of(PeerErrors),
    Column("failed_runs", "runs that could not be done; their figures are missing"),
    Column("frontier", "whether no other method is both faster and nearer to the mesh: tick_cpu_p50 and mesh_error"),
    Column(
        "times_ours", "tick_cpu_p50 over that of our fastest method whose mesh_error is no larger; NaN: there is none"
    ),
)


def table_rows(runs: Sequence[PeerRun]) -> list[Row]:
    """Return a row a run, then one for each method and object, then one for each method."""
    rows = [_row(run.object_name, run.motion, run.peer, [run]) for run in runs]
    by_object: dict[tuple[str, Peer], list[PeerRun]] = defaultdict(list)
    by_peer: dict[Peer, list[PeerRun]] = defaultdict(list)
    for run in runs:
        by_object[run.object_name, run.peer].append(run)
        by_peer[run.peer].append(run)
    rows += [_row(name, ALL, peer, group) for (name, peer), group in by_object.items()]
    rows += [_row(ALL, ALL, peer, group) for peer, group in by_peer.items()]
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
    return rows


def remarks(runs: Sequence[PeerRun]) -> list[str]:
    """Return remarks on the table, a sentence each."""
    return [
        "every method has the same hand, its phalanges capsules; no contact has friction",
        "times are CPU times of ticks with the haptic hand within 1 mm of the mesh, the median of the repetitions; "
        "compare them within this run, not between machines",
        "a body's distance from the mesh is coal's; off the mesh is a body that the method says is pushed by 0.01 N "
        "and more",
        *failure_remark(runs, lambda run: str(run.peer.method)),
    ]


def won_by_others(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of single scenes in which every method of ours is farther from the mesh or slower than it."""
    single = [row for row in rows if ALL not in (row["object"], row["motion"]) and not row["ours"]]
    # times_ours is NaN if none of ours is as near.
    return [r for r in single if not r["failed_runs"] and not r["times_ours"] >= 1.0 and not np.isnan(r["mesh_error"])]


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
        **totals_of(PeerErrors, errors),
        "failed_runs": sum(bool(run.failure) for run in runs),
        "frontier": False,
        "times_ours": np.nan,
    }
