"""Compile the kernels of `hhsim replay` while pip installs what they do not need: `make` runs it.

    python -m tools.compile_ahead

needs numpy, numba, h5py and msgspec. One process compiles the tick, one the programs in it and what measures its hands.
"""

import gc
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from typing import Any

import numpy as np

from tools.import_graph import REPOSITORY


def compile_ticks() -> None:
    """Compile the ticks of the usual method."""
    from hhsim.hand.model import HandModel
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.solver import warm_up

    warm_up(HandModel.default(), SolverOptions())


def compile_programs() -> None:
    """Compile a third of a tick, which `compile_ticks` comes to when this is done: its program, and its end."""
    from numba import typeof

    from hhsim.hand.model import HandModel
    from hhsim.kernels.world.linearisation import solve_with_pairs
    from hhsim.kernels.world.tick import finish_tick
    from hhsim.mesh.mesh import Mesh
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.workspace import TickWorkspace
    from hhsim.solver.world_engine import WorldEngine
    from hhsim.trees.contact_surface import contact_surface
    from hhsim.trees.sphere_tree import SphereTree

    ball = SphereTree(np.zeros((1, 3)), np.array([0.01]), np.zeros(1, np.int64), np.full(1, -1))
    surface = contact_surface("spheres", Mesh(np.eye(3), np.array([[0, 1, 2]])), ball).arrays
    engine = WorldEngine(TickWorkspace(HandModel.default(), surface, SolverOptions()))
    method, state, qp = engine.method, engine.states[0], engine.qp
    kernels: dict[Any, tuple[Any, ...]] = {
        solve_with_pairs: (method, 1, True, state, qp),
        finish_tick: (method, state, qp),
    }
    for kernel, arguments in kernels.items():
        kernel.callee.compile(tuple(typeof(argument) for argument in arguments))


def compile_measures() -> None:
    """Compile what a run's hands are measured with, by one hand on the bunny."""
    from hhsim.hand.forward_kinematics import forward_kinematics, hand_shape
    from hhsim.hand.model import HandModel
    from hhsim.hand.self_pairs import self_pairs
    from hhsim.kernels.rotation import rotate_quaternion
    from hhsim.mesh.catalogue import load_object
    from hhsim.metrics.moving_parts import TouchedObject
    from hhsim.motion.analytic_motion import still
    from hhsim.reproducible import arc_tangent
    from hhsim.solver.options import SolverOptions
    from hhsim.trees.cache import cached_sphere_tree
    from hhsim.trees.contact_surface import contact_surface
    from hhsim.trees.options import TreeOptions

    hand, mesh = HandModel.default(), load_object("bunny").mesh
    surface = contact_surface("spheres", mesh, cached_sphere_tree(mesh, TreeOptions(level=4))).arrays
    shape, fingers, touching = hand_shape(hand), np.ones(5, np.bool_), np.ones(1, np.bool_)
    motion = still(mesh.vertices[0])
    placed = forward_kinematics(hand, *motion)
    touched = TouchedObject(mesh, surface, shape, fingers, SolverOptions().touch)
    touched.contact_error(placed, touching)
    self_pairs(hand)
    arc_tangent(0.0, 1.0)
    rotate_quaternion(np.array([1.0, 0.0, 0.0, 0.0]), 0.1, 0.0, 0.0, np.empty(4))
    touched.input_hand(hand, motion, placed, touching, touching)


def find_data() -> None:
    """Make the folder of objects importable as `hhsim.objects`, as it will be once hhsim is installed."""
    folder = REPOSITORY / "objects"
    spec = spec_from_file_location("hhsim.objects", folder / "__init__.py", submodule_search_locations=[str(folder)])
    assert spec is not None and spec.loader is not None
    sys.modules["hhsim.objects"] = module_from_spec(spec)


def compile_others() -> None:
    """Compile all but what `compile_ticks` compiles before it needs this."""
    compile_programs()
    compile_measures()


PARTS = {"ticks": compile_ticks, "others": compile_others}

if __name__ == "__main__":
    if len(sys.argv) > 1:
        # numba asks for scipy, whose files may come just now, for a BLAS that no kernel calls.
        sys.modules["scipy"] = None  # type: ignore[assignment]
        find_data()
        gc.disable()  # a third of the time, in a process that soon ends
        PARTS[sys.argv[1]]()
    else:
        running = [subprocess.Popen([sys.executable, "-m", "tools.compile_ahead", part]) for part in PARTS]
        sys.exit(max(process.wait() for process in running))
