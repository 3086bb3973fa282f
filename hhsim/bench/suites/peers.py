"""MuJoCo beside our methods: the same hand, scenes and judge.

Errors are independent distances. Every method has a hand whose phalanges are capsules, which all engines know. The
haptic input of a scene is made once. The runs take turns; of each tick the median of the repetitions counts; long runs
are made once. Errors are those of the first repetition, against the true mesh. The table has every run, and every
method over its motions and objects.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hhsim.arrays import BoolArray, FloatArray
from hhsim.bench.figure_fields import columns_of, figure, mean, metric, metrics_of, totals_of, worst
from hhsim.bench.run_errors import NEAR, check_scenes, first_hold_tremor, hand_clearance, placed_of
from hhsim.bench.suite import Preset, Row, Suite, setting
from hhsim.bench.trade_off import (
    Run,
    failure_remark,
    groups_of,
    mark_frontier,
    percentile,
    summed_rows,
    tick_times,
    timed_row,
)
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.catalogue import load_object
from hhsim.metrics import metrics
from hhsim.metrics.mesh_penetration import sampled
from hhsim.metrics.run_ticks import RunTicks, hold_slices
from hhsim.motion.trajectory import TickInput
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from hhsim.scene.synthesis import synthesize
from hhsim.solver.hand_solver import HandSolver, warm_up
from hhsim.solver.known_methods import find_method
from hhsim.solver.method import FORCES
from hhsim.solver.method_names import declared_methods
from hhsim.solver.options import SolverOptions
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Count, Names, check_fields
from hhsim.table.file import ALL
from hhsim.table.table import Column, Table
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.contact_surface import contact_surface
from hhsim.verify.mesh_distance import HandReferee

OURS: tuple[tuple[str, str], ...] = (("coupled", "mesh"), ("coupled", "spheres"), ("penalty", "spheres"))
"""Our methods, and the surfaces that they touch."""
LONG = 5.0
"""CPU time of all ticks above which a run is not repeated [s]."""
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
        check_scenes(self.objects, self.motions)
        for name in self.methods or ():
            if FORCES not in find_method(name).gives:
                raise InputError(f"method {name} gives no forces: what it touches cannot be known")


@dataclass(frozen=True)
class Peer:
    """A method, and the surface that it is given; engines make their own of it."""

    method: str
    surface: str

    @property
    def ours(self) -> bool:
        """True for a method of hhsim's own."""
        return find_method(self.method).compiled


@dataclass(frozen=True)
class PeerErrors:
    """Errors of one run; NaN where undefined."""

    mesh_depth_max: float = figure("deepest penetration of the true mesh, at `samples` ticks", "mm", worst)
    mesh_depth_p95: float = figure(
        "95th percentile of the penetration of the true mesh, at `samples` ticks", "mm", worst
    )
    contact_error_mean: float = figure("distance from the true mesh of bodies that are pushed, mean", "mm", mean)
    contact_error_max: float = figure("distance from the true mesh of bodies that are pushed, largest", "mm", worst)
    mesh_error: float = figure("the larger of mesh_depth_max and contact_error_max", "mm", worst)
    palm_off_mean: float = figure("distance of the shown palm from the user's in contact, mean", "mm", mean)
    palm_lag_max: float = figure(
        "distance of the shown palm from the user's where nothing touches, largest", "mm", worst
    )
    force_hold: float = metric(mean, of="force_hold_mean")
    force_variation_hold: float = metric(mean)
    force_variation_tremor: float = metric(mean)
    force_step: float = metric(worst)
    force_step_newton: float = figure("largest one-tick change of the total force while moving", "N", worst)
    samples: int = figure("ticks at which the hand was held against the true mesh", "", sum)


@dataclass(frozen=True)
class _Scene:
    object_name: str
    motion: str
    haptic: TickInput
    contact: BoolArray
    referee: HandReferee
    surfaces: dict[str, Any]


@dataclass(frozen=True)
class _Cell:
    """One method on one scene."""

    scene: _Scene
    peer: Peer
    hand: HandModel
    options: PeersOptions


def capsule_hand() -> HandModel:
    """Return the default right hand, each finger with the mean of its radii."""
    hand = HandModel.default()
    return replace(hand, radius=np.repeat(hand.radius.mean(axis=1, keepdims=True), hand.radius.shape[1], axis=1))


def installed(options: PeersOptions) -> tuple[list[Peer], list[str]]:
    """Return the methods that can be run, and a line about each that cannot."""
    found, notes = [], []
    for name in options.methods or ():
        missing = find_method(name).missing
        if missing:
            notes.append(f"left out: {name} {missing}")
            continue
        surfaces = [surface for ours, surface in OURS if ours == name] or ["mesh"]
        if find_method(name).refuses_surfaces:
            surfaces = ["spheres"]
        found += [Peer(name, surface) for surface in surfaces]
    return found, notes


def cells(options: PeersOptions, progress: Progress) -> list[_Cell]:
    """Return all that is installed on every scene; InputError for nothing."""
    peers, notes = installed(options)
    if not peers:
        raise InputError("; ".join(notes))
    hand = capsule_hand()
    for peer in peers:
        warm_up(hand, SolverOptions(method=peer.method, surface=peer.surface))
    found = []
    for i, name in enumerate(options.objects):
        progress("scenes", i, len(options.objects))
        mesh = load_object(name).mesh
        tree = cached_sphere_tree(mesh)
        surfaces = {surface: contact_surface(surface, mesh, tree) for surface in ("mesh", "spheres")}
        referee = HandReferee(mesh)
        for motion in options.motions:
            trajectory = synthesize(load_script(motion), hand, tree, options.seed)
            ticks = make_scene(mesh, tree, hand, trajectory, rate=options.rate).hands[0].ticks.seen_from_object()
            placed = forward_kinematics(hand, *HandConfiguration.of(ticks))
            contact = hand_clearance(hand, surfaces["mesh"].arrays, placed, NEAR) < NEAR
            scene = _Scene(name, motion, ticks, contact, referee, surfaces)
            found += [_Cell(scene, peer, hand, options) for peer in peers]
    return found


def run_cell(cell: _Cell, before: Run | None) -> Run:
    """Run a method once more, unless it failed or takes long."""
    hand, scene, options = cell.hand, cell.scene, cell.options
    run = before or Run(scene.object_name, scene.motion, cell.peer)
    if run.failure or run.seconds > LONG:
        return run
    solver = SolverOptions(method=cell.peer.method, surface=cell.peer.surface).at_rate(options.rate)
    surface = scene.surfaces[cell.peer.surface]
    run.repeat(
        scene.contact,
        lambda: HandSolver(hand, surface, solver).run(*HandConfiguration.of(scene.haptic)),
        lambda record: _errors(hand, scene, surface, solver, record, options),
        # Of a method of ours its step is the whole tick.
        lambda record: record.duration_cpu if cell.peer.ours else record.duration[:, 1],
    )
    return run


def _errors(
    hand: HandModel, scene: _Scene, surface: Any, solver: SolverOptions, record: TickRecord, options: PeersOptions
) -> PeerErrors:
    haptic = scene.haptic
    off = np.linalg.norm(record.position - haptic.position, axis=1)
    push = pushes(record)
    looked = sampled(np.flatnonzero(scene.contact | (push > PUSHED).any(axis=1)), options.hands)
    clearance = scene.referee.clearances(hand_shape(hand), placed_of(record).at(looked), np.inf)
    depth = np.maximum(0.0, -clearance.min(axis=1))
    apart = np.abs(clearance[push[looked] > PUSHED])
    run = RunTicks(
        columns={"force/total": record.total, "force_variation_rate": metrics.force_variation_rate(record.total)},
        ticks=haptic.tick_count,
        phases=haptic.phases,
        rate=haptic.rate,
        fingers=len(solver.fingers),
    )
    moving = np.ones(haptic.tick_count, bool)
    for hold in hold_slices(haptic.phases, haptic.tick_count):
        moving[hold] = False
    steps = np.linalg.norm(np.diff(record.total, axis=0), axis=1)[moving[1:]]
    return PeerErrors(
        mesh_depth_max=worst(depth),
        mesh_depth_p95=float(np.percentile(depth, 95)) if depth.size else np.nan,
        contact_error_mean=mean(apart),
        contact_error_max=worst(apart),
        # NaN for a hand that nothing pushes, which would be perfect otherwise.
        mesh_error=float(np.maximum(worst(depth), worst(apart))),
        palm_off_mean=mean(off[scene.contact]),
        palm_lag_max=worst(off[~scene.contact & ~(push > 0.0).any(axis=1)]),
        **metrics_of(PeerErrors, run),
        force_variation_tremor=first_hold_tremor(hand, surface, solver, haptic, record, options.seed),
        force_step_newton=worst(steps),
        samples=len(looked),
    )


def pushes(record: TickRecord) -> FloatArray:
    """Return the size of the contact force on each body [N], shape (T, 16): 15 phalanges, then the palm."""
    phalanges = np.linalg.norm(record.phalanx, axis=-1).reshape(len(record.phalanx), -1)
    palm = np.linalg.norm(record.total - record.phalanx.sum(axis=(1, 2)), axis=1)
    return np.concatenate([phalanges, palm[:, None]], axis=1)


COLUMNS: tuple[Column, ...] = (
    Column("object", "object; 'all' sums up"),
    Column("motion", "motion; 'all' sums up"),
    Column("method", "method"),
    Column("surface", "surface that a method of ours touches; an engine makes its own, and is judged on the mesh"),
    Column("ours", "whether it is a method of hhsim's own"),
    Column("contact_ticks", "ticks with the haptic hand within 1 mm of the mesh or inside; times are of these"),
    Column("repetitions", "repetitions that the times are the median of; where a row sums up, the fewest"),
    Column("tick_cpu_p50", "CPU time of a tick in contact, the call from Python included, median", "µs"),
    Column("tick_cpu_p99", "CPU time of a tick in contact, the call from Python included, 99th percentile", "µs"),
    Column("native_cpu_p50", "CPU time of the engine's own step alone in such a tick, median", "µs"),
    Column("native_cpu_p99", "CPU time of the engine's own step alone in such a tick, 99th percentile", "µs"),
    *columns_of(PeerErrors),
    Column("failed_runs", "runs that could not be done; their figures are missing"),
    Column("frontier", "whether no other method is both faster and nearer to the mesh: tick_cpu_p50 and mesh_error"),
    Column(
        "times_ours", "tick_cpu_p50 over that of our fastest method whose mesh_error is no larger; NaN: there is none"
    ),
)


def table_rows(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return a row a run, then one for each method and object, then one for each method."""
    rows = summed_rows(runs, runs, _row)
    for group in groups_of(rows):
        mark_frontier(group, "frontier", "mesh_error")
        for row in group:
            as_good = [one["tick_cpu_p50"] for one in group if one["ours"] and one["mesh_error"] <= row["mesh_error"]]
            if as_good:
                row["times_ours"] = row["tick_cpu_p50"] / min(as_good)
    return rows


def remarks(runs: Sequence[Run]) -> list[str]:
    """Return remarks on the table, a sentence each."""
    return [
        "every method has the same hand, its phalanges capsules; no contact has friction",
        "times are CPU times of ticks with the haptic hand within 1 mm of the mesh, the median of the repetitions; "
        "compare them within this run, not between machines",
        "off the mesh is a body that the method says is pushed by 0.01 N and more",
        *failure_remark(runs, lambda run: str(run.way.method)),
    ]


def won_by_others(rows: Sequence[Row]) -> list[Row]:
    """Return the rows of single scenes in which every method of ours is farther from the mesh or slower than it."""
    single = [row for row in rows if ALL not in (row["object"], row["motion"]) and not row["ours"]]
    # times_ours is NaN if none of ours is as near.
    return [r for r in single if not r["failed_runs"] and not r["times_ours"] >= 1.0 and not np.isnan(r["mesh_error"])]


def _row(object_name: str, motion: str, runs: Sequence[Run]) -> dict[str, Any]:
    peer, native = runs[0].way, tick_times([run.other for run in runs])
    return {
        **totals_of(PeerErrors, []),
        **timed_row(object_name, motion, runs),
        "method": peer.method,
        "surface": peer.surface if peer.ours else "its own",
        "ours": peer.ours,
        "repetitions": min(len(run.cpu) for run in runs),
        "native_cpu_p50": percentile(native, 50.0),
        "native_cpu_p99": percentile(native, 99.0),
        "frontier": False,
        "times_ours": np.nan,
    }


def tables(options: PeersOptions, rows: Sequence[Row], figures: Any) -> list[Table]:
    """Return a table for each object, over its motions, by the time of a tick."""
    found = []
    for name in options.objects:
        summed = [row for row in rows if (row["object"], row["motion"]) == (name, ALL)]
        by_time = sorted(summed, key=lambda row: float(row["tick_cpu_p50"]))
        found.append(Table.of_records(COLUMNS, by_time, SHOWN, f"{name}: {', '.join(options.motions)}"))
    return found


def lines(options: PeersOptions, rows: Sequence[Row]) -> list[str]:
    """Say where none of our methods is as good as another."""
    won = won_by_others(rows)
    return [f"{row['object']}, {row['motion']}: none of ours is as near and as fast as {row['method']}" for row in won]


SHOWN = """
    method surface tick_cpu_p50=p50 tick_cpu_p99=p99 native_cpu_p50=step_alone mesh_depth_max=in_mesh
    mesh_depth_p95=p95 contact_error_max=off_mesh force_hold=hold force_variation_hold=still
    force_variation_tremor=trembling force_step_newton=force_step palm_lag_max=palm_lag times_ours=×_ours frontier
"""
SUITE = Suite(
    help="""Measure another physics engine beside our methods, on the same scenes, in one run.

    MuJoCo, tuned, is an optional extra, and left out where it is not installed. All have the same hand, its phalanges
    capsules. Errors are measured against the true mesh: the deepest penetration, and how far off the mesh a body is
    that is pushed. The table goes to an HDF5 and a CSV file, with a picture beside them.

    \b
    Examples:
      hhsim bench peers --quick
      hhsim bench peers --object bunny --motion grasp,slide --method coupled,mujoco
      hhsim bench peers --out peers.h5 --plot peers.png
    """,
    settings=PeersOptions,
    columns=COLUMNS,
    cells=cells,
    run=run_cell,
    rows=lambda options, runs: table_rows(runs),
    tables=tables,
    lines=lines,
    notes=lambda options, runs: [*installed(options)[1], *remarks(runs)],
    named=lambda cell: f"{cell.peer.method}, {cell.scene.object_name}, {cell.scene.motion}",
    preset=Preset(
        "quick",
        "The bunny grasped, once.",
        {"objects": ("bunny",), "motions": ("grasp",), "repetitions": 1, "hands": 60},
    ),
    picture="trade-off",
)
