"""Methods, tree levels, linearisations and QP solvers: what a tick costs against how far off it is.

The haptic input of a scene is made once, on the finest spheres; errors are against the mesh and the optimum on it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench import trade_off
from hhsim.bench.figures import Figure, figure, mean, metric, placed_of, worst
from hhsim.bench.suite import Preset, Row, Suite, setting
from hhsim.bench.trade_off import Cell, Run, Stage, Way, placed_at
from hhsim.errors import check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.metrics.mesh_penetration import sampled
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
from hhsim.table.table import Column
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import MOST_LEVEL, TreeOptions

DEFAULT_LEVEL = 4
NO_LEVEL = 0
"""Level of a way that touches the mesh itself."""
MANY = 20
"""Ways from which on the table has those on a frontier, and the usual ones, alone."""
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
    """Ways to solve the hand and scenes, each with each."""

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
        (), "QP solvers beside ours, driven from Python and slow. With --full: all installed ones.", "--qp"
    )
    repetitions: Count = setting(3, "Repetitions of every run that takes less than 5 s.")
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
            object.__setattr__(self, "methods", tuple(name for name in METHODS if self.surfaces_of(name)))
        backends = available_backends() if self.backends is None else self.backends
        object.__setattr__(self, "backends", tuple(name for name in backends if name != ACTIVE_SET))
        trade_off.check_scenes(self.objects, self.motions)
        check_known("method", self.methods or (), list(METHODS))
        check_known("QP solver", self.backends or (), available_backends())
        for method in self.methods or ():
            if not self.surfaces_of(method):
                # The solver raises its own error for this pair.
                SolverOptions(method=method, surface=self.surfaces[0])

    def surfaces_of(self, method: str) -> tuple[str, ...]:
        """Return the surfaces that a method takes."""
        refuses = METHODS[method].refuses_surfaces
        return tuple(name for name in self.surfaces if name == "spheres" or not refuses)


def ways(options: SpeedErrorOptions) -> list[Way]:
    """Return the ways that run every scene; `coupled` by its defaults with the other QP solvers, too."""
    found = [
        Way(SolverOptions(method=method, surface=surface, linearisations=most), level)
        for method in options.methods or ()
        for surface in options.surfaces_of(method)
        for level in (options.levels if surface == "spheres" else (NO_LEVEL,))
        for most in options.linearisations or (SolverOptions(method=method).linearisations,)
    ]
    if "coupled" in (options.methods or ()):
        surface = options.surfaces_of("coupled")[0]
        nearest = min(options.levels, key=lambda level: abs(level - DEFAULT_LEVEL))
        level = nearest if surface == "spheres" else NO_LEVEL
        found += [Way(SolverOptions(surface=surface, qp=qp), level) for qp in options.backends or ()]
    return found


def is_default(way: Way) -> bool:
    """Return True for the method's own defaults."""
    return way == Way(SolverOptions(method=way.solver.method), DEFAULT_LEVEL)


FIGURES: tuple[Figure, ...] = (
    metric("penetration_max", worst),
    figure("mesh_depth_max", "deepest penetration of the true mesh, at `samples` ticks", "µm", worst),
    metric("contact_error_max", worst),
    figure("mesh_error", "the larger of mesh_depth_max and contact_error_max", "µm", worst),
    figure("off_optimum_mean", "farthest of palm and tips from the converged optimum on the mesh, mean", "mm", mean),
    metric("force_variation_tremor", mean),
    metric("posture_jump_max", worst),
    metric("force_contact_step_share", worst),
    metric("stuck_ticks", np.nansum),
    metric("lag_ticks", np.nansum),
    figure("samples", "ticks at which the depth in the true mesh was measured", "", np.nansum),
)


def cells(options: SpeedErrorOptions, progress: Progress) -> list[Cell]:
    """Return every scene with every way; TrajectoryError for a motion that cannot be done on an object."""
    if options.peers is not None:
        rows_of(Path(options.peers), "peers")
    hand, chosen, finest = HandModel.default(), ways(options), max(options.levels)
    for method, surface in dict.fromkeys((way.solver.method, way.solver.surface) for way in chosen):
        warm_up(hand, SolverOptions(method=method, surface=surface))

    def tree(mesh: Any, level: int = finest) -> Any:
        return cached_sphere_tree(mesh, TreeOptions(level=level), progress)

    found: list[Cell] = []
    for stage in trade_off.stages(options, hand, tree, progress):
        errors = _errors(stage, options.hands)
        scenes = {level: stage.scene(tree(stage.mesh, level or finest)) for level in {way.level for way in chosen}}
        found += [Cell(stage, way, scenes[way.level], errors, "duration/total") for way in chosen]
    return found


def _errors(stage: Stage, hands: int) -> Callable[[Result], dict[str, float]]:
    """Return what measures a run: its depth in the true mesh at so many ticks, and its distance from the optimum."""
    optimum = placed_of(best_hands(stage.hand, stage.surface, SolverOptions(), HandConfiguration.of(stage.ticks)))
    shape, contact, closed = hand_shape(stage.hand), np.flatnonzero(stage.contact), stage.referee.surface.closed

    def measured(result: Result) -> dict[str, float]:
        deepest = [int(np.nanargmax(result["penetration_depth"]))]
        looked = sampled(contact, hands, deepest) if contact.size and closed else contact[:0]
        depth: FloatArray = np.zeros(0)
        if looked.size:
            # 0 - x and not -x: a free hand has depth 0, not minus 0.
            depth = 0.0 - stage.referee.clearances(shape, placed_at(result, looked), 0.0).min(axis=1)
        off = np.linalg.norm(placed_at(result, contact).ends - optimum.at(contact).ends, axis=2).max(axis=1)
        touched = float(result.summary.get("contact_error_max", np.nan))
        return {
            "mesh_depth_max": worst(depth),
            # NaN for a hand that touches nothing, which is not perfect.
            "mesh_error": float(np.maximum(worst(depth), touched)) if closed else touched,
            "off_optimum_mean": mean(off),
            "samples": float(len(depth)),
        }

    return measured


COLUMNS: tuple[Column, ...] = (
    *trade_off.SCENE_COLUMNS,
    Column("method", "method of the solver"),
    Column("surface", "what of the object the hand touches: the leaf spheres of its tree, or the mesh itself"),
    Column("level", f"level of the sphere tree; {NO_LEVEL} on the mesh, which has none"),
    Column("linearisations", "most linearisations in a tick"),
    Column("qp", "QP solver"),
    Column("is_default", "whether this is the method as it comes"),
    *trade_off.TIME_COLUMNS,
    *(one.column for one in FIGURES),
    Column("repeatable", "whether every repetition gave the same poses and forces"),
    Column("failed_runs", "runs that could not be done; their figures are missing, and they are on no frontier"),
    Column("mesh_frontier", "whether no way is both faster and nearer to the mesh: p50 and mesh_error"),
    Column("tracking_frontier", "whether none is both faster and nearer to the optimum: p50 and off_optimum_mean"),
)


def table_rows(done: Sequence[Run]) -> list[Row]:
    """Return a row a run, then one for each way and object, then one for each way."""

    def of_way(runs: Sequence[Run]) -> Row:
        way = runs[0].way
        return {
            **{name: getattr(way.solver, name) for name in ("method", "surface", "linearisations", "qp")},
            "level": way.level,
            "is_default": is_default(way),
            "repeatable": all(run.repeatable for run in runs),
            "mesh_frontier": False,
            "tracking_frontier": False,
        }

    rows = trade_off.summed_rows(done, FIGURES, of_way)
    for group in trade_off.competing(rows):
        trade_off.mark_frontier(group, "mesh_frontier", "mesh_error")
        trade_off.mark_frontier(group, "tracking_frontier", "off_optimum_mean")
    return rows


def remarks(done: Sequence[Run]) -> list[str]:
    """Return remarks on the table, a sentence each."""
    samples = sum(run.figures.get("samples", 0.0) for run in done)
    different = sorted({run.way.name for run in done if not run.repeatable})
    changing = f"the poses of {', '.join(different)} differ between repetitions: they are not deterministic"
    return [
        f"how deep the hand is in the true mesh is that of {samples:,.0f} ticks in contact; how far its contacts are "
        "off the mesh, and how deep it is in what it touches, is that of every tick",
        "the best pose is that of least coupling energy outside the mesh itself, whatever a way touches",
        trade_off.TIMES_REMARK,
        *([changing] if different else []),
        *trade_off.failure_remark(done),
    ]


def is_shown(rows: Sequence[Row], row: Row) -> bool:
    """Return True for ways over all scenes; of many, those on a frontier, and the usual."""
    over_all = [row for row in rows if row["object"] == row["motion"] == ALL]
    few = len(over_all) <= MANY or row["mesh_frontier"] or row["tracking_frontier"] or _as_it_comes(row)
    return bool(row["object"] == row["motion"] == ALL and few)


def _as_it_comes(row: Row) -> bool:
    """True for a method's defaults, its defaults on the mesh, or another QP solver."""
    on_mesh = row["surface"] == "mesh" and row["linearisations"] == SolverOptions(method=row["method"]).linearisations
    return bool(row["is_default"] or on_mesh or row["qp"] != ACTIVE_SET)


SHOWN = """
    method surface level linearisations=lin. qp tick_cpu_p50=CPU_p50 tick_cpu_p99=p99 penetration_max=in_surface
    mesh_depth_max=in_mesh contact_error_max=contacts_off off_optimum_mean=pose_off
    force_variation_tremor=trembling_force force_contact_step_share=force_step posture_jump_max=jump lag_ticks=lag
    stuck_ticks=stuck mesh_frontier tracking_frontier=pose_frontier
"""
SUITE = Suite(
    help="""Measure what a tick costs against how far off it is, for every way to solve the hand.

    Methods, surfaces, tree levels, linearisations and QP solvers take turns on the same motions. Errors are measured
    against the true mesh, by code apart from the solver, and against the converged optimum on it. A way is on the
    frontier if no other is both faster and better. The table goes to a JSON and a CSV file, with a picture beside
    them.

    \b
    Examples:
      hhsim bench speed-error
      hhsim bench speed-error --full
      hhsim bench speed-error --object cup --motion grasp --level 4,5 --qp daqp
      hhsim bench speed-error --surface mesh --method coupled --linearisations 12
      hhsim bench speed-error --out tradeoff.json --plot tradeoff.png
    """,
    settings=SpeedErrorOptions,
    columns=COLUMNS,
    cells=cells,
    run=trade_off.run_cell,
    rows=lambda options, done: table_rows(done),
    shown=SHOWN,
    is_shown=is_shown,
    sort="tick_cpu_p50",
    title=lambda options: f"Methods and what they touch ({', '.join(options.objects)}: {', '.join(options.motions)})",
    notes=lambda options, done: remarks(done),
    named=lambda cell: "runs",
    optional=("qp",),
    preset=FULL,
    draw=trade_off.draw,
)
