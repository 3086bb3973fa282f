"""One long random motion of `hhsim bench stress`: the object, the hand and the solver that it is run with."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from hhsim.bench.robustness.pieces import Pieces, pieces_of
from hhsim.bench.robustness.random_targets import RandomTargets, StressOptions
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree


@dataclass(frozen=True, eq=False, kw_only=True)
class StressCase:
    """One object, one method, one long motion.

    Attributes:
        object: Its name, or the file it is from.
        object_options: What a replay must be told of it, such as "--level 3 --unit mm".
        mesh: Its triangles, in the same frame; None where it is spheres alone.
        solver: Options of the solver, the method and the surface among them.
        stress: Options of the random targets.
        seed: Of the random targets.
        ticks: Length of the motion.
        keep: Folder for failing stretches, made when one is kept; None keeps none.
    """

    object: str
    object_options: str = ""
    tree: SphereTree
    mesh: Mesh | None = None
    hand: HandModel
    solver: SolverOptions
    stress: StressOptions
    seed: int
    ticks: int
    keep: Path | None = None

    def targets(self) -> RandomTargets:
        """The motion from its start: around the object's root sphere, the first hand above it."""
        center, radius = self.tree.center[0], float(self.tree.radius[0])
        return RandomTargets(self.hand, self.seed, self.stress, center=center, height=max(0.25, radius + 0.2))

    @cached_property
    def surface(self) -> Any:
        """What the hand touches, in the kernels' form."""
        return contact_surface(self.solver.surface, self.mesh, self.tree).arrays

    @cached_property
    def pieces(self) -> Pieces:
        """The same for brute force."""
        return pieces_of(self.solver.surface, self.mesh, self.tree)

    def new_solver(self) -> HandSolver:
        """A solver that has seen nothing yet."""
        return HandSolver(self.hand, self.surface, self.solver)
