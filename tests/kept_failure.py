"""A failure that a stress test kept, run again from its file as `hhsim replay` does."""

import json
from pathlib import Path
from typing import Any

from hhsim.bench.robustness.failure import MADE_BY, Solver, Trace, failure_of, make_trial
from hhsim.bench.robustness.local_optimality import pieces_of
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.mesh.mesh import Mesh
from hhsim.motion.file import load_trajectory
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions, Stiffness
from hhsim.trees.contact_surface import contact_surface
from hhsim.trees.sphere_tree import SphereTree


def rerun_failure(
    path: Path, hand: HandModel, tree: SphereTree, solver: Solver | None = None, mesh: Mesh | None = None
) -> Trace:
    """What a kept failure gives, by a solver of the options that the file names where none is given."""
    trajectory = load_trajectory(path)
    origin = json.loads(trajectory.source.removeprefix(MADE_BY))
    values: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in origin["solver"].items()
    }
    values["stiffness"] = Stiffness(**values["stiffness"])
    options = SolverOptions(**values)
    motion = HandConfiguration.of(trajectory.resampled(1000.0, "hold"))
    fails = failure_of(origin["kind"], hand, pieces_of(options.surface, mesh, tree), options)
    surface = contact_surface(options.surface, mesh, tree).arrays
    return make_trial(hand, solver or (lambda: HandSolver(hand, surface, options)), fails)(motion)
