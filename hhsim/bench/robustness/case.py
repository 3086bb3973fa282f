"""Hard cases: seeded runs of a hand against an object, and the figures, each with its bar, that judge them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.figures import hand_clearance, placed_of
from hhsim.bench.robustness.objects import RIM, ball, ball_mesh, crossings, right_hand
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.kernels.tick.state import STATUS_SNAP
from hhsim.mesh.mesh import Mesh
from hhsim.metrics.metrics import frozen_decay
from hhsim.solver.options import UNBOUNDED, UNLIMITED, USUAL, SolverOptions
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


Figures: TypeAlias = Iterable[Figure]


@dataclass(frozen=True, eq=False)
class HardRun:
    """One hand that moves against one object."""

    name: str
    motion: HandConfiguration  # haptic hand, tick by tick
    tree: SphereTree | None = None  # leaf spheres of the object, world; None for an object of triangles alone
    mesh: Mesh | None = None  # triangles of the object, world; None for an object of spheres alone
    # Its own figures; of figures of one name in several runs of a case the worst counts.
    judge: "Callable[[Outcome], Figures]" = lambda outcome: ()
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
            options = replace(options, surface="spheres", skin=USUAL, touch=USUAL)
        return self.adapt(options)


Runs: TypeAlias = Iterable[HardRun]


def ball_run(name: str, motion: HandConfiguration, **more: Any) -> HardRun:
    """Return a run against the ball that most scenes have."""
    return HardRun(name, motion, ball(4000), ball_mesh(), **more)


def to_convergence(options: SolverOptions) -> SolverOptions:
    """Return options with which each tick arrives: differences are then due to the rows, and not to where it ends."""
    if options.method not in ("coupled", "progressive"):
        return options
    return replace(options, step_tolerance=1e-7, linearisations=60, budget=UNLIMITED, snap_speed=UNBOUNDED)


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a run by one method."""

    run: HardRun
    options: SolverOptions  # options that it was solved with
    surface: Any  # arrays of the surface that the hand touched
    before: "Sequence[Outcome]" = ()  # outcomes of the case's runs before it
    record: TickRecord | None = None  # ticks of the last repeat of the motion; None if the method refused the scene
    refusal: str = ""  # message of the refusal, else empty
    safety: Mapping[str, Any] = field(default_factory=dict)  # figures of `SafetyMeasure`, of all ticks
    limit_excess: float = 0.0  # largest excess of a joint beyond its limits [rad]
    # Graphic hands at the marks: joints and palm [m], shape (repeats, marks, 21, 3).
    marked: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 21, 3)))
    # Resident memory of the process after each repeat [B], shape (repeats,).
    memory: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def ticks(self) -> TickRecord:
        """Record of a run that was not refused."""
        assert self.record is not None
        return self.record

    @property
    def points(self) -> FloatArray:
        """Joints and palm of the graphic hand [m], shape (T, 21, 3)."""
        return placed_of(self.ticks).points

    def ticks_with(self, *bits: int, ticks: slice = slice(None)) -> int:
        """Return the number of ticks that have one of these bits of the status."""
        return int((self.ticks.status[ticks] & sum(bits) > 0).sum())

    def gap(self, tick: int) -> float:
        """Return the signed distance of hand and surface at a tick [m]."""
        return float(hand_clearance(self.run.hand, self.surface, placed_of(self.ticks).at([tick]), 1.0)[0])

    def rest(self, ticks: slice, name: str | None = None) -> Figure:
        """Return the figure of the ticks until the force rests, once the input is frozen and the hand snaps no more."""
        snaps = np.flatnonzero(self.ticks.status[ticks] & STATUS_SNAP)
        decay = frozen_decay(self.ticks.total[ticks][snaps.max(initial=-1) + 1 :])
        name = self.run.name if name is None else name
        return Figure(f"ticks to rest{name and ', '}{name}", np.inf if decay is None else decay, REST)

    def left(self, after: str, bar: float = 1e-6) -> Figure:
        """Return the figure of the distance [m] of graphic and haptic palm in the last tick."""
        away = np.linalg.norm(self.ticks.position[-1] - self.run.motion.position[-1])
        return Figure(f"distance left after {after}", float(away), bar, "m")

    def through(self, thing: str, radius: float) -> Figure:
        """Return the figure of points that went through a disc of this radius [m] in the plane z = 0."""
        return Figure(f"points of the hand that went through the {thing}", crossings(self.points, radius - RIM), 0)


@dataclass(frozen=True)
class HardCase:
    """A named scene that breaks methods; in all, penetration, finite numbers, limits and stuck ticks are judged."""

    name: str  # in kebab-case
    description: str  # one line
    build: Callable[[int], Runs]  # returns the runs of a seed
    may_refuse: bool = False  # True if a clear refusal is as good as a sound motion
    mesh_only: bool = False  # True if its objects are triangles alone


def named_cases(*builds: Callable[[int], Runs], **how: bool) -> tuple[HardCase, ...]:
    """Return the cases of these functions: each has the function's name, and its docstring as the description."""
    return tuple(
        HardCase(build.__name__.replace("_", "-"), str(build.__doc__).removesuffix("."), build, **how)
        for build in builds
    )


def own_figures(outcomes: Sequence[Outcome]) -> list[Figure]:
    """Return the figures of a case whose runs were not refused: of those of one name the sum of counts, or the worst.

    NaN is the worst.
    """
    found: dict[str, Figure] = {}
    for new in (figure for outcome in outcomes for figure in outcome.run.judge(outcome)):
        old = found.setdefault(new.name, new)
        is_worse = new.value < old.value if new.at_least else new.value > old.value
        if old is not new and isinstance(new.value, int):
            found[new.name] = replace(old, value=old.value + new.value)
        elif is_worse or np.isnan(new.value):
            found[new.name] = new
    return list(found.values())
