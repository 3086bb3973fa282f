"""Methods, tree levels, linearisations and QP solvers: what a tick costs against how far off it is.

The haptic input of a scene is made once, on the finest spheres; errors are against the mesh and the optimum on it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.figures import Figure, figure, mean, metric, worst
from hhsim.bench.suite import Preset, Row, Suite, setting
from hhsim.bench.tick_records import placed_of
from hhsim.bench.trade_off import (
    Cell,
    Run,
    Stage,
    check_scenes,
    competing,
    draw,
    failure_remark,
    mark_frontier,
    percentile,
    placed_at,
    run_cell,
    stages,
    summed_rows,
    tick_times,
)
from hhsim.errors import check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.metrics.mesh_penetration import sampled
from hhsim.metrics.run_ticks import hold_slices
from hhsim.result.reader import Result
from hhsim.solver.hand_solver import warm_up
from hhsim.solver.method import METHODS
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import ACTIVE_SET, available_backends
from hhsim.solver.reference_optimum import best_hands
from hhsim.solver.surface import SURFACES
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Count, Names, a_list, between, check_fields
from hhsim.table.file import ALL, rows_of
from hhsim.table.table import Column, Table
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import MOST_LEVEL, TreeOptions

DEFAULT_LEVEL = 4
NO_LEVEL = 0
"""Level of a configuration that touches the mesh itself."""
MANY = 20
"""Configurations from which on the table has those on a frontier, and the usual ones, alone."""
STRETCH = 50
"""Ticks of the first hold up to which QP solvers are compared: others are driven from Python, and slow."""
MOST_HANDS = 400
"""Hands of a run whose depth is measured, 6 to 18 ms each."""
FULL = Preset(
    "full",
    "Three objects, four motions, all linearisations and QP solvers.",
    {
        "objects": ("bunny", "teapot", "cube"),
        "motions": ("grasp", "pinch", "whole-hand", "slide"),
        "levels": (2, 3, 4, 5),
        "linearisations": (1, 2, 3, 12),
        "backends": None,
        "hands": MOST_HANDS,
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
        None, "Most linearisations in a tick. With --full: 1,2,3,12. Default: the method's own."
    )
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
    # Limit of the hands of a run whose depth in the mesh is measured.
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
        check_scenes(self.objects, self.motions)
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
        for most in options.linearisations or (usual_linearisations(method),)
    ]


def backend_configurations(options: SpeedErrorOptions) -> list[Configuration]:
    """Return the configurations of `coupled` with all QP solvers, up to the first hold of the first motion."""
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


FIGURES: tuple[Figure, ...] = (
    metric("penetration_max", worst),
    figure("mesh_depth_max", "deepest penetration of the true mesh, at `samples` ticks", "µm", worst),
    metric("contact_error_max", worst),
    figure("mesh_error", "the larger of mesh_depth_max and contact_error_max", "µm", worst),
    metric("tracking_excess", mean),
    figure("off_optimum_mean", "farthest of palm and tips from the converged optimum on the mesh, mean", "mm", mean),
    metric("force_variation_tremor", mean),
    metric("posture_jump_max", worst),
    metric("force_contact_step_share", worst),
    metric("stuck_ticks", np.nansum),
    metric("lag_ticks", np.nansum),
    figure("samples", "ticks at which the depth in the true mesh was measured", "", np.nansum),
)


def cells(options: SpeedErrorOptions, progress: Progress) -> list[Cell]:
    """Return every scene with every configuration; TrajectoryError for a motion that cannot be done on an object."""
    if options.peers is not None:
        rows_of(Path(options.peers), "peers")
    hand = HandModel.default()
    whole, part = configurations(options), backend_configurations(options)
    for method in options.methods or ():
        for surface in options.surfaces_of(method):
            warm_up(hand, SolverOptions(method=method, surface=surface))
    finest = max(options.levels)
    found: list[Cell] = []
    for stage in stages(
        options, hand, lambda mesh: cached_sphere_tree(mesh, TreeOptions(level=finest), progress), progress
    ):
        errors = _errors(stage, options.hands)
        ways = [*whole, *(part if stage.motion == options.motions[0] else ())]
        trees = {
            way.level: cached_sphere_tree(stage.mesh, TreeOptions(level=way.level or finest), progress) for way in ways
        }
        holds = hold_slices(stage.ticks.phases, stage.ticks.tick_count)
        for way in ways:
            scene = stage.scene(trees[way.level])
            if way.stretch and holds:
                scene = scene.first(holds[0].start + STRETCH)
            found.append(Cell(stage, way, scene, way.solver_options(), errors, "duration/total"))
    return found


def _errors(stage: Stage, hands: int) -> Callable[[Result], dict[str, float]]:
    """Return what measures a run: its depth in the true mesh at so many ticks, and its distance from the optimum."""
    optimum = placed_of(best_hands(stage.hand, stage.surface, SolverOptions(), HandConfiguration.of(stage.ticks)))
    shape = hand_shape(stage.hand)

    def measured(result: Result) -> dict[str, float]:
        contact = np.flatnonzero(stage.contact[: result.ticks])
        shown = placed_at(result, contact)
        deepest = [int(np.nanargmax(result["penetration_depth"]))]
        looked = sampled(contact, hands, deepest) if contact.size and stage.referee.surface.closed else contact[:0]
        depth: FloatArray = np.zeros(0)
        if looked.size:
            # 0 - x and not -x: a free hand has depth 0, not minus 0.
            depth = 0.0 - stage.referee.clearances(shape, placed_at(result, looked), 0.0).min(axis=1)
        off = np.linalg.norm(shown.ends - optimum.at(contact).ends, axis=2).max(axis=1)
        touched = float(result.summary.get("contact_error_max", np.nan))
        return {
            "mesh_depth_max": worst(depth),
            # NaN for a hand that touches nothing, which is not perfect.
            "mesh_error": float(np.maximum(worst(depth), touched)) if stage.referee.surface.closed else touched,
            "off_optimum_mean": mean(off),
            "samples": float(len(depth)),
        }

    return measured


COLUMNS: tuple[Column, ...] = (
    Column("object", "object; 'all' sums up"),
    Column("motion", "motion; 'all' sums up"),
    Column("method", "method of the solver"),
    Column("surface", "what of the object the hand touches: the leaf spheres of its tree, or the mesh itself"),
    Column("level", f"level of the sphere tree; {NO_LEVEL} on the mesh, which has none"),
    Column("linearisations", "most linearisations in a tick"),
    Column("qp", "QP solver"),
    Column("stretch", "whether only the ticks up to the first hold were run, to set QP solvers side by side"),
    Column("is_default", "whether this is the method as it comes"),
    Column("contact_ticks", "ticks with the haptic hand within 1 mm of the object or inside; times are of these"),
    Column("tick_cpu_p50", "CPU time of a tick in contact, median", "µs"),
    Column("tick_cpu_p99", "CPU time of a tick in contact, 99th percentile", "µs"),
    Column("tick_wall_p50", "wall time of a tick in contact, median", "µs"),
    *(one.column for one in FIGURES),
    Column("repeatable", "whether every repetition gave the same poses and forces"),
    Column("failed_runs", "runs that could not be done; their figures are missing, and they are on no frontier"),
    Column("mesh_frontier", "whether no configuration is both faster and nearer to the mesh: p50 and mesh_error"),
    Column("tracking_frontier", "whether none is both faster and nearer to the optimum: p50 and off_optimum_mean"),
)


def table_rows(done: Sequence[Run]) -> list[Row]:
    """Return a row a run, then one for each configuration and object, then one for each configuration.

    Runs of a stretch are summed up over all objects only.
    """

    def of_way(runs: Sequence[Run]) -> Row:
        configuration: Configuration = runs[0].way
        return {
            **asdict(configuration),
            "is_default": configuration.is_default and configuration.qp == ACTIVE_SET,
            "tick_wall_p50": percentile(tick_times([run.other for run in runs]), 50.0),
            "repeatable": all(run.repeatable for run in runs),
            "mesh_frontier": False,
            "tracking_frontier": False,
        }

    rows = summed_rows(done, FIGURES, of_way, lambda run: not run.way.stretch)
    for group in competing([row for row in rows if not row["stretch"]]):
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
    samples = sum(run.figures.get("samples", 0.0) for run in done)
    found = [
        f"how deep the hand is in the true mesh is that of {samples:,.0f} ticks in contact; how far its contacts are "
        "off the mesh, and how deep it is in what it touches, is that of every tick",
        "the best pose is that of least coupling energy outside the mesh itself, whatever a configuration touches",
        "times are of the ticks with the haptic hand within 1 mm of the object, the median of the repetitions; compare "
        "them within this run, not between machines",
    ]
    changing = [run.way for run in done if not run.repeatable]
    different = sorted({one.method if one.qp == ACTIVE_SET else f"{one.method} with {one.qp}" for one in changing})
    if different:
        found.append(f"the poses of {', '.join(different)} differ between repetitions: they are not deterministic")
    return [*found, *failure_remark(done, lambda way: f"{way.method}, {touched(way.surface, way.level)}")]


def tables(options: SpeedErrorOptions, rows: Sequence[Row], figures: Any) -> list[Table]:
    """Return the configurations over all scenes, by the time of a tick; of many those on a frontier and the usual."""
    summed, solvers = chosen(rows, object=ALL, motion=ALL), chosen(rows, object=ALL, motion=ALL, stretch=True)
    where = f"{', '.join(options.objects)}: {', '.join(options.motions)}"
    best = [row for row in summed if row["mesh_frontier"] or row["tracking_frontier"]]
    usual = [row for row in summed if _as_it_comes(row)]
    found = [(f"Methods and what they touch ({where})", summed, SHOWN)]
    if len(summed) > MANY:
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
    off_optimum_mean=off_best_pose
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
    draw=draw,
)
