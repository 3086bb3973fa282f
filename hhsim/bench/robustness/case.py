"""What a hard case is: seeded runs of a hand against an object, and the figures, each with its bar, that judge them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.tick.block import TickRecord
from hhsim.mesh.mesh import Mesh
from hhsim.solver.options import BY_SURFACE, SolverOptions
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree

DEEPEST = 1e-6
"""Penetration [m] that every case allows: a hundredth of what the paper shows, and far below what anybody feels."""


@dataclass(frozen=True)
class Figure:
    """A measured figure and the bar that it has to keep.

    Attributes:
        name: What it is.
        value: Measured; NaN keeps no bar.
        bar: At most this, or at least.
        unit: Of both, SI; empty for counts.
        at_least: The bar is a lower one.
    """

    name: str
    value: float
    bar: float
    unit: str = ""
    at_least: bool = False

    @property
    def passed(self) -> bool:
        """Whether the bar is kept."""
        return self.value >= self.bar if self.at_least else self.value <= self.bar


@dataclass(frozen=True, eq=False)
class HardRun:
    """One hand that moves against one object.

    Attributes:
        name: Among the runs of its case.
        tree: The object's leaf spheres, world frame; None where it is triangles alone.
        motion: What the haptic hand does.
        adapt: What the case changes in the options of the method.
        lead: Ticks before the motion, judged like it.
        repeats: How many times the motion is done, one after the other.
        marks: Ticks of the motion whose shown hand is kept each time.
        scale: The scene's lengths over those of a hand; penetrations are judged in proportion.
        mesh: The object's triangles, world frame; None where it is spheres alone.
    """

    name: str
    hand: HandModel
    tree: SphereTree | None
    motion: HandConfiguration
    adapt: Callable[[SolverOptions], SolverOptions] = lambda options: options
    lead: HandConfiguration | None = None
    repeats: int = 1
    marks: tuple[int, ...] = ()
    scale: float = 1.0
    mesh: Mesh | None = None

    def solver(self, options: SolverOptions) -> SolverOptions:
        """What it is solved with: on the spheres where there are no triangles, and as the case has it."""
        if options.surface == "mesh" and self.mesh is None:
            options = replace(options, surface="spheres", skin=BY_SURFACE, touch=BY_SURFACE)
        return self.adapt(options)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a method made of a run.

    Attributes:
        options: What it was solved with.
        record: The ticks of the motion, the last time it was done; None where the method refused the scene.
        refusal: What the method said when it refused, else empty.
        ticks_done: Ticks of all blocks.
        penetration: Worst depth over all ticks [m], NaN where the hand was nowhere.
        nonfinite: Numbers of the record that are not finite.
        limit_excess: How far a joint was beyond its limits at most [rad].
        stuck: Ticks that kept the last feasible hand.
        unexplained: Of those, the ones from where a hand can move, see `hhsim.bench.robustness.local_optimality`.
        lagging: Ticks with distance still to go.
        lag: The most of it [m].
        marked: Shown hands at the marks: joints and palm [m], shape (repeats, marks, 21, 3).
        memory: Resident memory of the process after each repeat [B], shape (repeats,).
    """

    run: HardRun
    options: SolverOptions
    record: TickRecord | None
    refusal: str = ""
    ticks_done: int = 0
    penetration: float = 0.0
    nonfinite: int = 0
    limit_excess: float = 0.0
    stuck: int = 0
    unexplained: int = 0
    lagging: int = 0
    lag: float = 0.0
    marked: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 21, 3)))
    memory: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def surface(self) -> Any:
        """What the hand touched, in the kernels' form."""
        return contact_surface(self.options.surface, self.run.mesh, self.run.tree).arrays

    @property
    def ticks(self) -> TickRecord:
        """The record of a run that was not refused."""
        assert self.record is not None
        return self.record


@dataclass(frozen=True)
class HardCase:
    """A named scene that breaks methods.

    Attributes:
        name: Kebab-case.
        description: One line.
        build: Makes the runs from a seed.
        judge: The case's own figures, from the outcomes in the order of the runs; penetration, finite numbers, limits
            and stuck ticks are judged for every case alike.
        may_refuse: A clear refusal is as good as a sound motion.
        mesh_only: Its objects are triangles alone.
    """

    name: str
    description: str
    build: Callable[[int], Sequence[HardRun]]
    judge: Callable[[Sequence[Outcome]], Sequence[Figure]] = lambda outcomes: ()
    may_refuse: bool = False
    mesh_only: bool = False
