"""MuJoCo beside our methods: the same hand, scenes and judge.

Every method has a hand whose phalanges are capsules, which all engines know. Errors are those of the true mesh, and of
the bodies that a method says are pushed: what an engine touches is its own.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench import trade_off
from hhsim.bench.figures import Figure, figure, mean, metric, worst
from hhsim.bench.suite import Preset, Row, Suite, setting
from hhsim.bench.trade_off import Cell, Run, Stage, Way, placed_at
from hhsim.errors import InputError
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.metrics.mesh_penetration import sampled
from hhsim.result.reader import Result
from hhsim.solver.hand_solver import warm_up
from hhsim.solver.known_methods import find_method
from hhsim.solver.method import FORCES
from hhsim.solver.method_names import declared_methods
from hhsim.solver.options import SolverOptions
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Count, Names, check_fields
from hhsim.table.file import ALL
from hhsim.table.table import Column
from hhsim.trees.cache import cached_sphere_tree

OURS: tuple[tuple[str, str], ...] = (("coupled", "mesh"), ("coupled", "spheres"), ("penalty", "spheres"))
"""Our methods, and the surfaces that they touch."""
PUSHED = 1e-2
"""Least force of a body that touches [N]: stiff engines ring."""


@dataclass(frozen=True)
class PeersOptions:
    """Objects, motions and methods, each with each."""

    objects: Names = setting(("bunny", "teapot", "cube", "sphere"), "Objects.", "--object")
    motions: Names = setting(("grasp", "slide", "whole-hand"), "Motions that touch the object.", "--motion")
    methods: Names | None = setting(
        None,
        "Methods, of hhsim or from outside. Default: coupled, penalty, and every engine that is installed.",
        "--method",
    )
    repetitions: Count = setting(3, "Repetitions of every run that takes less than 5 s.")
    rate: float = setting(1000.0)
    seed: int = setting(0)
    hands: Count = 200  # limit of the hands of a run that are measured against the true mesh

    def __post_init__(self) -> None:
        """Fill in the methods; raise InputError for unknown names, empty lists and numbers out of range."""
        check_fields(self)
        if self.methods is None:
            declared = (name for name, entry in declared_methods().items() if entry.dist and entry.dist.name == "hhsim")
            object.__setattr__(self, "methods", (*dict.fromkeys(name for name, _ in OURS), *sorted(declared)))
        trade_off.check_scenes(self.objects, self.motions)
        for name in self.methods or ():
            if FORCES not in find_method(name).gives:
                raise InputError(f"method {name} gives no forces: what it touches cannot be known")


def is_ours(way: Way) -> bool:
    """Return True for a method of hhsim's own."""
    return find_method(way.solver.method).compiled


FIGURES: tuple[Figure, ...] = (
    figure("mesh_depth_max", "deepest penetration of the true mesh, at `samples` ticks", "mm", worst),
    figure("mesh_depth_p95", "95th percentile of the penetration of the true mesh", "mm", worst),
    figure("contact_error_max", "distance from the true mesh of bodies that are pushed, largest", "mm", worst),
    figure("mesh_error", "the larger of mesh_depth_max and contact_error_max", "mm", worst),
    metric("free_off_max", worst),
    metric("force_hold_mean", mean),
    metric("force_variation_hold", mean),
    metric("force_variation_tremor", mean),
    metric("force_contact_step", worst),
    figure("samples", "ticks at which the hand was held against the true mesh", "", np.nansum),
)


def capsule_hand() -> HandModel:
    """Return the default right hand, each finger with the mean of its radii."""
    hand = HandModel.default()
    return replace(hand, radius=np.repeat(hand.radius.mean(axis=1, keepdims=True), hand.radius.shape[1], axis=1))


def installed(options: PeersOptions) -> tuple[list[Way], list[str]]:
    """Return the methods that can be run, on the surfaces that they are given, and a line about each that cannot."""
    found, notes = list[Way](), list[str]()
    for name in options.methods or ():
        missing = find_method(name).missing
        if missing:
            notes.append(f"left out: {name} {missing}")
            continue
        surfaces = [surface for ours, surface in OURS if ours == name] or ["mesh"]
        if find_method(name).refuses_surfaces:
            surfaces = ["spheres"]
        found += [Way(SolverOptions(method=name, surface=surface)) for surface in surfaces]
    return found, notes


def cells(options: PeersOptions, progress: Progress) -> list[Cell]:
    """Return all that is installed on every scene; InputError for nothing."""
    ways, notes = installed(options)
    if not ways:
        raise InputError("; ".join(notes))
    hand = capsule_hand()
    for way in ways:
        warm_up(hand, way.solver)
    found = []
    for stage in trade_off.stages(options, hand, cached_sphere_tree, progress):
        scene, errors = stage.scene(cached_sphere_tree(stage.mesh)), _errors(stage, options.hands)
        # Of a method of ours its step is the whole tick.
        times = {way: "duration/total_cpu" if is_ours(way) else "duration/palm" for way in ways}
        found += [Cell(stage, way, scene, errors, times[way]) for way in ways]
    return found


def _errors(stage: Stage, hands: int) -> Callable[[Result], dict[str, float]]:
    """Return what measures a run at so many ticks: its depth in the mesh, and how far off it pushed bodies are."""
    shape = hand_shape(stage.hand)

    def measured(result: Result) -> dict[str, float]:
        push = pushes(result["force/phalanx"], result["force/total"])
        looked = sampled(np.flatnonzero(stage.contact | (push > PUSHED).any(axis=1)), hands)
        clearance = stage.referee.clearances(shape, placed_at(result, looked), np.inf)
        depth = np.maximum(0.0, -clearance.min(axis=1))
        apart = np.abs(clearance[push[looked] > PUSHED])
        return {
            "mesh_depth_max": worst(depth),
            "mesh_depth_p95": float(np.percentile(depth, 95.0)) if depth.size else np.nan,
            "contact_error_max": worst(apart),
            # NaN for a hand that nothing pushes, which would be perfect otherwise.
            "mesh_error": float(np.maximum(worst(depth), worst(apart))),
            "samples": float(len(looked)),
        }

    return measured


def pushes(phalanx: FloatArray, total: FloatArray) -> FloatArray:
    """Return the size of the contact force on each body [N], shape (T, 16): 15 phalanges, then the palm.

    Forces on phalanges have shape (T, 5, 3, 3), the sum of all (T, 3).
    """
    palm = np.linalg.norm(total - phalanx.sum(axis=(1, 2)), axis=1)
    return np.concatenate([np.linalg.norm(phalanx, axis=-1).reshape(len(phalanx), -1), palm[:, None]], axis=1)


COLUMNS: tuple[Column, ...] = (
    *trade_off.SCENE_COLUMNS,
    Column("method", "method"),
    Column("surface", "surface that a method of ours touches; an engine makes its own, and is judged on the mesh"),
    Column("ours", "whether it is a method of hhsim's own"),
    Column("repetitions", "repetitions that the times are the median of; where a row sums up, the fewest"),
    *trade_off.TIME_COLUMNS,
    Column("native_cpu_p50", "CPU time of the engine's own step alone in such a tick, median", "µs"),
    *(one.column for one in FIGURES),
    Column("failed_runs", "runs that could not be done; their figures are missing"),
    Column("frontier", "whether no other method is both faster and nearer to the mesh: tick_cpu_p50 and mesh_error"),
    Column(
        "times_ours", "tick_cpu_p50 over that of our fastest method whose mesh_error is no larger; NaN: there is none"
    ),
)


def table_rows(runs: Sequence[Run]) -> list[Row]:
    """Return a row a run, then one for each method and object, then one for each method."""

    def of_way(group: Sequence[Run]) -> Row:
        way = group[0].way
        return {
            "method": way.solver.method,
            "surface": way.solver.surface if is_ours(way) else "its own",
            "ours": is_ours(way),
            "repetitions": min(len(run.cpu) for run in group),
            "native_cpu_p50": trade_off.median_percentile([run.other for run in group], 50.0),
            "frontier": False,
            "times_ours": np.nan,
        }

    rows = trade_off.summed_rows(runs, FIGURES, of_way)
    for group in trade_off.competing(rows):
        trade_off.mark_frontier(group, "frontier", "mesh_error")
        for row in group:
            as_good = [one["tick_cpu_p50"] for one in group if one["ours"] and one["mesh_error"] <= row["mesh_error"]]
            if as_good:
                row["times_ours"] = row["tick_cpu_p50"] / min(as_good)
    return rows


def remarks(runs: Sequence[Run]) -> list[str]:
    """Return remarks on the table, a sentence each."""
    return [
        "every method has the same hand, its phalanges capsules; no contact has friction",
        trade_off.TIMES_REMARK,
        "off the mesh is a body that the method says is pushed by 0.01 N and more",
        *trade_off.failure_remark(runs),
    ]


def lines(options: PeersOptions, rows: Sequence[Row]) -> list[str]:
    """Say in which scenes every method of ours is farther from the mesh than another, or slower than it."""
    single = [row for row in rows if ALL not in (row["object"], row["motion"]) and not row["ours"]]
    # times_ours is NaN if none of ours is as near.
    return [
        f"{row['object']}, {row['motion']}: none of ours is as near and as fast as {row['method']}"
        for row in single
        if not row["failed_runs"] and not row["times_ours"] >= 1.0 and not np.isnan(row["mesh_error"])
    ]


SHOWN = """
    method surface tick_cpu_p50=p50 tick_cpu_p99=p99 native_cpu_p50=step_alone mesh_depth_max=in_mesh
    mesh_depth_p95=p95 contact_error_max=off_mesh force_hold_mean=hold force_variation_hold=still
    force_variation_tremor=trembling force_contact_step=force_step free_off_max=off_in_air times_ours=×_ours frontier
"""
SUITE = Suite(
    help="""Measure another physics engine beside our methods, on the same scenes, in one run.

    MuJoCo, tuned, is an optional extra, and left out where it is not installed. All have the same hand, its phalanges
    capsules. Errors are measured against the true mesh: the deepest penetration, and how far off the mesh a body is
    that is pushed. The table goes to a JSON and a CSV file, with a picture beside them.

    \b
    Examples:
      hhsim bench peers --quick
      hhsim bench peers --object bunny --motion grasp,slide --method coupled,mujoco
      hhsim bench peers --out peers.json --plot peers.png
    """,
    settings=PeersOptions,
    columns=COLUMNS,
    cells=cells,
    run=trade_off.run_cell,
    rows=lambda options, runs: table_rows(runs),
    shown=SHOWN,
    is_shown=lambda rows, row: row["object"] != ALL == row["motion"],
    sort="tick_cpu_p50",
    by="object",
    title=lambda options: ", ".join(options.motions),
    lines=lines,
    notes=lambda options, runs: [*installed(options)[1], *remarks(runs)],
    named=lambda cell: f"{cell.way.name}, {cell.stage.object}, {cell.stage.motion}",
    preset=Preset(
        "quick",
        "The bunny grasped, once.",
        {"objects": ("bunny",), "motions": ("grasp",), "repetitions": 1, "hands": 60},
    ),
    draw=trade_off.draw,
)
