"""Hard cases: seeded runs of a hand against an object, and the figures, each with its bar, that judge them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.bench.robustness.objects import ball, ball_mesh, right_hand
from hhsim.bench.tick_records import placed_of
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import frozen_decay
from hhsim.solver.options import BY_SURFACE, SolverOptions
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree

DEEPEST = 1e-6
"""Penetration [m] that every case allows: a hundredth of what the paper shows, and far below what anybody feels."""
REST = 20
"""Ticks after which the force of a frozen input must be still, as for every replay."""


@dataclass(frozen=True)
class Figure:
    """A measured figure and its bar in SI units; an upper bar unless `at_least`. NaN keeps no bar."""

    name: str
    value: float
    bar: float
    unit: str = ""
    at_least: bool = False

    @property
    def passed(self) -> bool:
        """True if the bar is kept."""
        return self.value >= self.bar if self.at_least else self.value <= self.bar


@dataclass(frozen=True, eq=False)
class HardRun:
    """One hand that moves against one object."""

    name: str
    motion: HandConfiguration  # haptic hand, tick by tick
    tree: SphereTree | None = None  # leaf spheres of the object, world; None for an object of triangles alone
    mesh: Mesh | None = None  # triangles of the object, world; None for an object of spheres alone
    hand: HandModel = field(default_factory=right_hand)
    # Changes the options of the method for this run.
    adapt: Callable[[SolverOptions], SolverOptions] = lambda options: options
    lead: HandConfiguration | None = None  # ticks before the motion, judged like it
    repeats: int = 1  # number of times that the motion is done, one after the other
    marks: tuple[int, ...] = ()  # ticks of the motion whose graphic hand is kept each time
    scale: float = 1.0  # lengths of the scene over those of a usual hand; penetrations are judged in proportion

    def solver(self, options: SolverOptions) -> SolverOptions:
        """Return the options of this run: with spheres if the object has no triangles, and adapted."""
        if options.surface == "mesh" and self.mesh is None:
            options = replace(options, surface="spheres", skin=BY_SURFACE, touch=BY_SURFACE)
        return self.adapt(options)


def ball_run(name: str, motion: HandConfiguration) -> HardRun:
    """Return a run against the ball that most scenes have."""
    return HardRun(name, motion, ball(4000), ball_mesh())


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a run by one method."""

    run: HardRun
    options: SolverOptions  # options that it was solved with
    record: TickRecord | None  # ticks of the last repeat of the motion; None if the method refused the scene
    refusal: str = ""  # message of the refusal, else empty
    safety: Mapping[str, Any] = field(default_factory=dict)  # figures of `SAFETY`, of all ticks
    limit_excess: float = 0.0  # largest excess of a joint beyond its limits [rad]
    # Graphic hands at the marks: joints and palm [m], shape (repeats, marks, 21, 3).
    marked: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 21, 3)))
    # Resident memory of the process after each repeat [B], shape (repeats,).
    memory: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def surface(self) -> Any:
        """Arrays of the surface that the hand touched."""
        return contact_surface(self.options.surface, self.run.mesh, self.run.tree).arrays

    @property
    def ticks(self) -> TickRecord:
        """Record of a run that was not refused."""
        assert self.record is not None
        return self.record


@dataclass(frozen=True)
class HardCase:
    """A named scene that breaks methods."""

    name: str  # in kebab-case
    description: str  # one line
    build: Callable[[int], Sequence[HardRun]]  # returns the runs of a seed
    # Returns the case's own figures, from the outcomes in the order of the runs; penetration, finite numbers, joint
    # limits and stuck ticks are judged for every case.
    judge: Callable[[Sequence[Outcome]], Sequence[Figure]] = lambda outcomes: ()
    may_refuse: bool = False  # True if a clear refusal is as good as a sound motion
    mesh_only: bool = False  # True if its objects are triangles alone


def rest_figure(outcome: Outcome, ticks: slice, name: str = "ticks to rest") -> Figure:
    """Return the figure of the ticks that the force takes to rest, once the input is frozen."""
    decay = frozen_decay(outcome.ticks.total[ticks])
    return Figure(name, np.inf if decay is None else decay, REST)


def rest_of_run(outcome: Outcome, ticks: slice) -> Figure:
    """Return `rest_figure` under the name of its run."""
    return rest_figure(outcome, ticks, f"ticks to rest, {outcome.run.name}")


def distance_left(outcomes: Sequence[Outcome], name: str, bar: float = 1e-6) -> Figure:
    """Return the figure of the largest distance [m] of graphic and haptic palm in the last tick of the runs."""
    away = [np.linalg.norm(o.ticks.position[-1] - o.run.motion.position[-1]) for o in outcomes]
    return Figure(name, float(np.max(away)), bar, "m")


def largest_step(points: ArrayLike) -> float:
    """Return the largest way of a point from one tick to the next [m]; points of shape (T, ..., 3)."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=-1).max())


def shown_points(record: TickRecord) -> FloatArray:
    """Return joints and palm of the graphic hand [m], shape (T, 21, 3)."""
    return placed_of(record).points


def motion_difference(first: TickRecord, second: TickRecord) -> float:
    """Return the largest distance [m] of a joint or the palm of one record from the other's."""
    return float(np.linalg.norm(shown_points(first) - shown_points(second), axis=-1).max())
