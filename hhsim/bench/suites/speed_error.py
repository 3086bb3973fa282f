"""Methods, tree levels, linearisations and QP solvers: what a tick costs against how far off it is.

The haptic input of a scene is made once, on the finest spheres; errors are against the mesh and the optimum on it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.figures import mean, placed_of, worst
from hhsim.bench.suite import Row
from hhsim.bench.trade_off import Cell, Run, Stage, TradeOff, Way, mark_frontier, placed_at
from hhsim.errors import check_known
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.forward_kinematics import hand_shape
from hhsim.hand.model import HandModel
from hhsim.metrics.mesh_penetration import sampled
from hhsim.replay.reference import best_hands
from hhsim.result.reader import Result
from hhsim.solver.method import METHODS, SURFACES
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import ACTIVE_SET, available_backends
from hhsim.solver.solver import warm_up
from hhsim.system.progress import Progress
from hhsim.system.settings_file import Count, Names, a_list, between
from hhsim.table.file import ALL
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import MOST_LEVEL, TreeOptions

DEFAULT_LEVEL = 4
NO_LEVEL = 0
"""Level of a way that touches the mesh itself."""
MANY = 20
"""Ways from which on the table has those on a frontier, and the usual ones, alone."""


def is_default(way: Way) -> bool:
    """Return True for the method's own defaults."""
    return way == Way(SolverOptions(method=way.solver.method), DEFAULT_LEVEL)


def _as_it_comes(row: Row) -> bool:
    """True for a method's defaults, its defaults on the mesh, or another QP solver."""
    on_mesh = row["surface"] == "mesh" and row["linearisations"] == SolverOptions(method=row["method"]).linearisations
    return bool(row["is_default"] or on_mesh or row["qp"] != ACTIVE_SET)


def _errors(stage: Stage, hands: int) -> Callable[[Result], dict[str, float]]:
    """Return what measures a run: its depth in the true mesh at so many ticks, and its distance from the optimum."""
    optimum = placed_of(best_hands(stage.hand, stage.surface, SolverOptions(), HandConfiguration.of(stage.ticks)))
    shape, contact, closed = hand_shape(stage.hand), np.flatnonzero(stage.contact), stage.referee.closed

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


@dataclass(frozen=True, kw_only=True)
class SpeedError(TradeOff):
    """Ways to solve the hand and scenes, each with each."""

    surfaces: Names
    levels: Annotated[tuple[Annotated[int, between(1, MOST_LEVEL)], ...], a_list("2, 3")]
    linearisations: Annotated[tuple[Count, ...], a_list("1, 12")] | None
    backends: tuple[str, ...]  # "all" for all that are installed

    def check(self) -> None:
        """Fill in the methods; raise InputError for unknown names."""
        check_known("surface", self.surfaces, SURFACES.names())
        if self.methods is None:
            object.__setattr__(self, "methods", tuple(name for name in METHODS if self.surfaces_of(name)))
        super().check()
        check_known("method", self.methods or (), list(METHODS))
        check_known("QP solver", self.other_qps, available_backends())
        for method in self.methods or ():
            if not self.surfaces_of(method):
                # The solver raises its own error for this pair.
                SolverOptions(method=method, surface=self.surfaces[0])

    @property
    def other_qps(self) -> list[str]:
        """QP solvers beside ours."""
        named = available_backends() if self.backends == ("all",) else self.backends
        return [name for name in named if name != ACTIVE_SET]

    def surfaces_of(self, method: str) -> tuple[str, ...]:
        """Return the surfaces that a method takes."""
        refuses = METHODS[method].refuses_surfaces
        return tuple(name for name in self.surfaces if name == "spheres" or not refuses)

    def ways(self) -> list[Way]:
        """Return the ways that run every scene; `coupled` by its defaults with the other QP solvers, too."""
        found = [
            Way(SolverOptions(method=method, surface=surface, linearisations=most), level)
            for method in self.methods or ()
            for surface in self.surfaces_of(method)
            for level in (self.levels if surface == "spheres" else (NO_LEVEL,))
            for most in self.linearisations or (SolverOptions(method=method).linearisations,)
        ]
        if "coupled" in (self.methods or ()):
            surface = self.surfaces_of("coupled")[0]
            nearest = min(self.levels, key=lambda level: abs(level - DEFAULT_LEVEL))
            level = nearest if surface == "spheres" else NO_LEVEL
            found += [Way(SolverOptions(surface=surface, qp=qp), level) for qp in self.other_qps]
        return found

    def cells(self, progress: Progress) -> list[Cell]:
        """Return every scene with every way; TrajectoryError for a motion that cannot be done on an object."""
        hand, chosen, finest = HandModel.default(), self.ways(), max(self.levels)
        for method, surface in dict.fromkeys((way.solver.method, way.solver.surface) for way in chosen):
            warm_up(hand, SolverOptions(method=method, surface=surface))

        def tree(mesh: Any, level: int = finest) -> Any:
            return cached_sphere_tree(mesh, TreeOptions(level=level), progress)

        found: list[Cell] = []
        for stage in self.stages(hand, tree, progress):
            errors = _errors(stage, self.hands)
            scenes = {level: stage.scene(tree(stage.mesh, level or finest)) for level in {way.level for way in chosen}}
            found += [Cell(stage, way, scenes[way.level], errors, "duration/total") for way in chosen]
        return found

    def of_way(self, runs: Sequence[Run]) -> Row:
        """Return what a row has of the solver."""
        way = runs[0].way
        return {
            **{name: getattr(way.solver, name) for name in ("method", "surface", "linearisations", "qp")},
            "level": way.level,
            "is_default": is_default(way),
            "repeatable": all(run.repeatable for run in runs),
            "mesh_frontier": False,
            "tracking_frontier": False,
        }

    def mark(self, group: Sequence[Row]) -> None:
        """Mark both frontiers."""
        mark_frontier(group, "mesh_frontier", "mesh_error")
        mark_frontier(group, "tracking_frontier", "off_optimum_mean")

    def notes(self, figures: Sequence[Run]) -> list[str]:
        """Return remarks on the table, a sentence each."""
        samples = sum(run.figures.get("samples", 0.0) for run in figures)
        different = sorted({run.way.name for run in figures if not run.repeatable})
        changing = f"the poses of {', '.join(different)} differ between repetitions: they are not deterministic"
        return [
            f"how deep the hand is in the true mesh is that of {samples:,.0f} ticks in contact; how far its contacts "
            "are off the mesh, and how deep it is in what it touches, is that of every tick",
            "the best pose is that of least coupling energy outside the mesh itself, whatever a way touches",
            *([changing] if different else []),
            *super().notes(figures),
        ]

    def is_shown(self, rows: Sequence[Row], row: Row) -> bool:
        """Return True for ways over all scenes; of many, those on a frontier, and the usual."""
        over_all = [row for row in rows if row["object"] == row["motion"] == ALL]
        few = len(over_all) <= MANY or row["mesh_frontier"] or row["tracking_frontier"] or _as_it_comes(row)
        return bool(row["object"] == row["motion"] == ALL and few)

    def title(self) -> str:
        """Return the scenes."""
        return f"Methods and what they touch ({', '.join(self.objects)}: {', '.join(self.motions)})"


SUITE = SpeedError
