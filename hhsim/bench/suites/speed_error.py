"""Methods, tree levels, linearisations and QP solvers: what a tick costs against how far off it is.

A scene is one motion of the catalogue on one object; its haptic input is made once, on the finest spheres. The runs
take turns: all configurations of all scenes, then all again in the opposite order, so that other load of the machine
falls on all of them; of each tick the median of the repetitions counts. Errors are those of the first repetition,
against the mesh and the optimum on it; the others must give the same poses.
"""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hhsim.bench import run_errors as runs
from hhsim.bench.figure_fields import columns_of, metric_column, totals_of
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
from hhsim.errors import check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.catalogue import load_object
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import make_scene
from hhsim.scene.synthesis import synthesize
from hhsim.solver.hand_solver import HandSolver, warm_up
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import ACTIVE_SET, available_backends
from hhsim.solver.surface import SURFACES
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Count, Names, a_list, between, check_fields
from hhsim.table.file import ALL, rows_of
from hhsim.table.table import Column, Table
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.options import MOST_LEVEL, TreeOptions

DEFAULT_LEVEL = 4
NO_LEVEL = 0
"""Level of a configuration that touches the mesh itself."""
EVERY: tuple[int, ...] = (1, 2, 3, 12)
LINEARISATIONS: dict[str, tuple[int, ...]] = {"paper": (1, 2, 3), "penalty": (12,)}
"""Limits of the linearisations in a tick, by method, if not `EVERY`: `paper` makes all of them; `penalty` linearises
once, and the number bounds the rounds of its step."""
STRETCH = (100, 50)
"""Ticks before and after the start of the first hold that QP solvers are compared on: other solvers are driven from
Python, at milliseconds a tick."""
FULL = Preset(
    "full",
    "Three objects, four motions, all linearisations and QP solvers.",
    {
        "objects": ("bunny", "teapot", "cube"),
        "motions": ("grasp", "pinch", "whole-hand", "slide"),
        "levels": (2, 3, 4, 5),
        "every_linearisation": True,
        "backends": None,
        "hands": runs.MOST_HANDS,
    },
)


@dataclass(frozen=True)
class SpeedErrorOptions:
    """Configurations and scenes, each with each."""

    objects: Names = setting(("bunny",), "Objects. With --full: bunny,teapot,cube.", "--object")
    motions: Names = setting(
        ("grasp", "slide"), "Motions that touch. With --full: grasp,pinch,whole-hand,slide.", "--motion"
    )
    methods: Names | None = setting(None, "Methods. Default: all that take one of the surfaces.", "--method")
    surfaces: Names = setting(
        ("spheres", "mesh"), "What of the object the hand touches; paper and penalty take spheres alone.", "--surface"
    )
    levels: Annotated[tuple[Annotated[int, between(1, MOST_LEVEL)], ...], a_list("2, 3")] = setting(
        (2, 3, 4), "Levels of the sphere tree. With --full: 2,3,4,5.", "--level"
    )
    linearisations: Annotated[tuple[Count, ...], a_list("1, 12")] | None = setting(
        None,
        "Most linearisations in a tick. With --full: 1,2,3,12; of method paper 1,2,3; of penalty 12. Default: the "
        "method's own.",
    )
    every_linearisation: bool = False  # True for those of `LINEARISATIONS`
    # None for all that are installed.
    backends: tuple[str, ...] | None = setting(
        (),
        "QP solvers beside ours, on a stretch of each object's first motion. With --full: all installed ones.",
        "--qp",
    )
    repetitions: Count = setting(3, "Repetitions of every run.")
    rate: float = setting(1000.0)
    seed: int = setting(0)
    peers: str | None = setting(
        None, "Draw the engines of this table of hhsim bench peers into the picture, in grey.", metavar="FILE"
    )
    # Limit of the hands of a run whose depth in the mesh is measured; identical ones count once.
    hands: int = 100

    def __post_init__(self) -> None:
        """Fill in what is installed; raise InputError for unknown names, empty lists and numbers out of range."""
        check_fields(self)
        check_known("surface", self.surfaces, SURFACES.names())
        if self.methods is None:
            known = tuple(name for name in METHODS if self.surfaces_of(name))
            object.__setattr__(self, "methods", known)
        backends = available_backends() if self.backends is None else self.backends
        object.__setattr__(self, "backends", tuple(name for name in backends if name != ACTIVE_SET))
        runs.check_scenes(self.objects, self.motions)
        check_known("method", self.methods or (), list(METHODS))
        if self.backends:
            check_known("QP solver", self.backends, available_backends())
        for method in self.methods or ():
            if not self.surfaces_of(method):
                # The solver raises its own error for this pair.
                SolverOptions(method=method, surface=self.surfaces[0])

    def surfaces_of(self, method: str) -> tuple[str, ...]:
        """Return the surfaces that a method takes."""
        refuses = METHODS[method].refuses_surfaces
        return tuple(name for name in self.surfaces if name == "spheres" or not refuses)

    def linearisations_of(self, method: str) -> tuple[int, ...]:
        """Return the limits of the linearisations in a tick that a method is run with."""
        usual = LINEARISATIONS.get(method, EVERY) if self.every_linearisation else (usual_linearisations(method),)
        return self.linearisations or usual


@dataclass(frozen=True)
class Configuration:
    """One way to solve the hand; `stretch` if for a part of the motion only, see `STRETCH`."""

    method: str
    level: int
    linearisations: int
    qp: str = ACTIVE_SET
    stretch: bool = False
    surface: str = "spheres"

    @property
    def is_default(self) -> bool:
        """True for the method's own defaults."""
        usual = ("spheres", DEFAULT_LEVEL, usual_linearisations(self.method), False)
        return (self.surface, self.level, self.linearisations, self.stretch) == usual

    def solver_options(self) -> SolverOptions:
        """Return the options of the solver."""
        return SolverOptions(method=self.method, surface=self.surface, qp=self.qp, linearisations=self.linearisations)


@dataclass(frozen=True)
class _Scene:
    object_name: str
    motion: str
    hand: HandModel
    errors: runs.ErrorScene
    surfaces: dict[tuple[str, int], Any]
    """Arrays by the surface and the level of a configuration."""


def usual_linearisations(method: str) -> int:
    """Return the method's default limit of the linearisations in a tick."""
    return SolverOptions(method=method).linearisations


def configurations(options: SpeedErrorOptions) -> list[Configuration]:
    """Return the configurations that run every scene, the whole motion."""
    return [
        Configuration(method, level, most, surface=surface)
        for method in options.methods or ()
        for surface in options.surfaces_of(method)
        for level in (options.levels if surface == "spheres" else (NO_LEVEL,))
        for most in options.linearisations_of(method)
    ]


def backend_configurations(options: SpeedErrorOptions) -> list[Configuration]:
    """Return the configurations of `coupled` with all QP solvers, for a stretch of the first motion on every object."""
    method = "coupled"
    if not options.backends or method not in (options.methods or ()):
        return []
    surface = options.surfaces_of(method)[0]
    nearest = min(options.levels, key=lambda level: abs(level - DEFAULT_LEVEL))
    level = nearest if surface == "spheres" else NO_LEVEL
    return [
        Configuration(method, level, usual_linearisations(method), qp, stretch=True, surface=surface)
        for qp in (ACTIVE_SET, *options.backends)
    ]


def cells(options: SpeedErrorOptions, progress: Progress) -> list[tuple[_Scene, Configuration]]:
    """Return every scene with every configuration; TrajectoryError for a motion that cannot be done on an object."""
    if options.peers is not None:
        rows_of(Path(options.peers), "peers")
    hand = HandModel.default()
    whole, part = configurations(options), backend_configurations(options)
    for method in options.methods or ():
        for surface in options.surfaces_of(method):
            warm_up(hand, SolverOptions(method=method, surface=surface))
    found: list[tuple[_Scene, Configuration]] = []
    count = len(options.objects) * len(options.motions)
    for i, name in enumerate(options.objects):
        mesh = load_object(name).mesh
        levels = options.levels if "spheres" in options.surfaces else (max(options.levels),)
        trees = {level: cached_sphere_tree(mesh, TreeOptions(level=level), progress) for level in levels}
        finest = trees[max(trees)]
        triangles = contact_surface("mesh", mesh, finest).arrays
        surfaces: dict[tuple[str, int], Any] = {("spheres", level): tree.arrays() for level, tree in trees.items()}
        surfaces["mesh", NO_LEVEL] = triangles
        referee = runs.MeshReferee(mesh, options.hands)
        for j, motion in enumerate(options.motions):
            progress("scenes, with their optima", i * len(options.motions) + j, count)
            trajectory = synthesize(load_script(motion), hand, finest, options.seed)
            ticks = make_scene(mesh, finest, hand, trajectory, rate=options.rate).hands[0].ticks.seen_from_object()
            errors = runs.error_scene(hand, referee, ticks, triangles, SolverOptions(), options.seed)
            scene = _Scene(name, motion, hand, errors, surfaces)
            found += [(scene, one) for one in (*whole, *(part if j == 0 else ()))]
    return found


def run_cell(cell: tuple[_Scene, Configuration], before: Run | None) -> Run:
    """Run a configuration on a scene once more, unless it failed."""
    scene, configuration = cell
    run = before or Run(scene.object_name, scene.motion, configuration)
    if run.failure:
        return run
    hand, haptic = scene.hand, scene.errors.haptic
    window = slice(0, haptic.tick_count)
    if configuration.stretch:
        begin = scene.errors.holds[0].start if scene.errors.holds else 0
        window = slice(max(0, begin - STRETCH[0]), min(haptic.tick_count, begin + STRETCH[1]))
    surface, options = scene.surfaces[configuration.surface, configuration.level], configuration.solver_options()

    def play() -> TickRecord:
        solver = HandSolver(hand, surface, options)
        if window.start > 0:
            # Where our own QP solver has the hand before the stretch, so that all solvers begin alike.
            own = HandSolver(hand, surface, replace(configuration, qp=ACTIVE_SET).solver_options())
            led = own.run(*HandConfiguration.of(haptic).part(0, window.start))
            solver.place(*HandConfiguration.of(led).at(-1))
        return solver.run(*HandConfiguration.of(haptic).at(window))

    run.repeat(
        scene.errors.contact[window],
        play,
        lambda record: runs.run_errors(scene.errors, surface, options, record, window),
        lambda record: record.duration_total,
    )
    return run


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
    Column("tick_cpu_p50", "CPU time of a tick in contact, median", "µs"),
    Column("tick_cpu_p99", "CPU time of a tick in contact, 99th percentile", "µs"),
    Column("tick_cpu_max", "CPU time of a tick in contact, most", "µs"),
    Column("tick_wall_p50", "wall time of a tick in contact, median", "µs"),
    Column("tick_wall_p99", "wall time of a tick in contact, 99th percentile", "µs"),
    Column("over_1ms", "share of ticks in contact over 1 ms, CPU"),
    Column("work_p50", "work units of a tick in contact, median: the same on any machine; NaN for a method without"),
    *columns_of(runs.RunErrors),
    Column("repeatable", "whether every repetition gave the same poses and forces"),
    Column("failed_runs", "runs that could not be done; their figures are missing, and they are on no frontier"),
    Column("mesh_frontier", "whether no configuration is both faster and nearer to the mesh: p50 and mesh_error"),
    Column("tracking_frontier", "whether none is both faster and nearer to the optimum: p50 and off_optimum_mean"),
)


def table_rows(done: Sequence[Run]) -> list[dict[str, Any]]:
    """Return a row a run, then one for each configuration and object, then one for each configuration.

    Runs of a stretch are summed up over all objects only.
    """
    whole = [run for run in done if not run.way.stretch]
    rows = summed_rows(done, whole, _row)
    for group in groups_of([row for row in rows if not row["stretch"]]):
        mark_frontier(group, "mesh_frontier", "mesh_error")
        mark_frontier(group, "tracking_frontier", "off_optimum_mean")
    return rows


def chosen(rows: Iterable[Any], *, stretch: bool = False, **values: Any) -> list[Any]:
    """Return the rows of whole motions, or of stretches, that have these values, such as object="all"."""
    return [row for row in rows if row["stretch"] == stretch and all(row[name] == v for name, v in values.items())]


def touched(surface: str, level: int) -> str:
    """Return the surface and level in words."""
    return f"level {level}" if surface == "spheres" else surface


def remarks(done: Sequence[Run]) -> list[str]:
    """Return remarks on the table, a sentence each."""
    measured = [(run, run.errors) for run in done if run.errors is not None]
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
    changing = [run.way for run in done if not run.repeatable]
    different = sorted({one.method if one.qp == ACTIVE_SET else f"{one.method} with {one.qp}" for one in changing})
    if different:
        found.append(f"the poses of {', '.join(different)} differ between repetitions: they are not deterministic")

    def named(run: Run) -> str:
        return f"{run.way.method}, {touched(run.way.surface, run.way.level)}"

    return [*found, *failure_remark(done, named)]


def _row(object_name: str, motion: str, done: Sequence[Run]) -> dict[str, Any]:
    configuration = done[0].way
    cpu, wall = tick_times([run.cpu for run in done]), tick_times([run.other for run in done])
    candidates, work = (np.concatenate([getattr(run, kind) for run in done]) for kind in ("candidates", "work"))
    return {
        **totals_of(runs.RunErrors, []),
        **timed_row(object_name, motion, done),
        **asdict(configuration),
        "is_default": configuration.is_default and configuration.qp == ACTIVE_SET,
        "ticks": sum(run.ticks for run in done),
        "candidates_max": int(candidates.max(initial=0)),
        "tick_cpu_max": percentile(cpu, 100.0),
        "tick_wall_p50": percentile(wall, 50.0),
        "tick_wall_p99": percentile(wall, 99.0),
        "over_1ms": float(np.mean(cpu > 1e-3)) if cpu.size else np.nan,
        "work_p50": percentile(work, 50.0) if work.any() else np.nan,
        "repeatable": all(run.repeatable for run in done),
        "mesh_frontier": False,
        "tracking_frontier": False,
    }


def tables(options: SpeedErrorOptions, rows: Sequence[Row], figures: Any) -> list[Table]:
    """Return the configurations over all scenes, by the time of a tick; of many those on a frontier and the usual."""
    summed, solvers = chosen(rows, object=ALL, motion=ALL), chosen(rows, object=ALL, motion=ALL, stretch=True)
    where = f"{', '.join(options.objects)}: {', '.join(options.motions)}"
    best = [row for row in summed if row["mesh_frontier"] or row["tracking_frontier"]]
    usual = [row for row in summed if _as_it_comes(row)]
    found = [(f"Methods and what they touch ({where})", summed, SHOWN)]
    if options.every_linearisation:
        found = [(f"Nothing is both faster and better ({where})", best, SHOWN)]
        found.append(("Methods as they come, and on the mesh", usual, SHOWN))
    if solvers:
        how = f"{solvers[0]['method']}, {touched(solvers[0]['surface'], solvers[0]['level'])}"
        title = f"QP solvers, {how}, on a stretch; all but ours are driven from Python"
        found.append((title, solvers, SOLVERS_SHOWN))
    by_time = [(title, sorted(some, key=lambda row: float(row["tick_cpu_p50"])), names) for title, some, names in found]
    return [Table.of_records(COLUMNS, some, names, title) for title, some, names in by_time if some]


def _as_it_comes(row: Row) -> bool:
    """True for a method's defaults, or its defaults on the mesh."""
    on_mesh = row["surface"] == "mesh" and row["linearisations"] == usual_linearisations(row["method"])
    return bool(row["is_default"] or on_mesh)


SHOWN = """
    method surface level linearisations=lin. tick_cpu_p50=CPU_p50 tick_cpu_p99=p99 penetration_max=in_surface
    mesh_depth_max=in_mesh contact_error_max=contacts_off off_optimum_mean=pose_off
    force_variation_tremor=trembling_force force_contact_step_share=force_step posture_jump_max=jump lag_ticks=lag
    stuck_ticks=stuck mesh_frontier tracking_frontier=pose_frontier
"""
SOLVERS_SHOWN = """
    qp=QP_solver tick_cpu_p50=CPU_p50 tick_cpu_p99=p99 tick_wall_p50=wall_p50 penetration_max=in_surface
    off_optimum_mean=off_best_pose ticks
"""
SUITE = Suite(
    help="""Measure what a tick costs against how far off it is, for every way to solve the hand.

    Methods, surfaces, tree levels, linearisations and QP solvers take turns on the same motions. Errors are measured
    against the true mesh, by code apart from the solver, and against the converged optimum on it. A configuration is on
    the frontier if no other is both faster and better. The table goes to an HDF5 and a CSV file, with a picture beside
    them.

    \b
    Examples:
      hhsim bench speed-error
      hhsim bench speed-error --full
      hhsim bench speed-error --object cup --motion grasp --level 4,5 --qp daqp
      hhsim bench speed-error --surface mesh --method coupled --linearisations 12
      hhsim bench speed-error --out tradeoff.h5 --plot tradeoff.png
    """,
    settings=SpeedErrorOptions,
    columns=COLUMNS,
    cells=cells,
    run=run_cell,
    rows=lambda options, done: table_rows(done),
    tables=tables,
    notes=lambda options, done: remarks(done),
    named=lambda cell: "runs",
    preset=FULL,
    picture="trade-off",
)
