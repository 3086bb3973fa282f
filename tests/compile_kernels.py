"""Compile what most tests run, in two processes side by side: workers then load it instead of each compiling its own.

What comes later in a process finds there what it shares with what came before.

`python tests/compile_kernels.py`; what lies in the cache already is loaded, in a few seconds.
"""

import gc
import subprocess
import sys
from pathlib import Path
from typing import Any

from hhsim.mesh.catalogue import load_object
from hhsim.mesh.mesh import Mesh
from hhsim.trees.builder import build_sphere_tree
from hhsim.trees.options import TreeOptions
from hhsim.trees.triangle_tree import triangle_tree


def trees() -> None:
    """What builds trees, and closes fingers on them."""
    from hhsim.hand.model import HandModel
    from hhsim.scene.motion_catalogue import load_script
    from hhsim.scene.scene import make_scene

    mesh = load_object("cylinder").mesh
    make_scene(mesh, build_sphere_tree(mesh, TreeOptions(level=2)), HandModel.default(), load_script("grasp"))


def ticks(*methods: str, surface: str = "spheres") -> None:
    """What a tick of these methods runs; on spheres, what threads that help it run, too."""
    from hhsim.hand.model import HandModel
    from hhsim.solver.method import METHODS
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.solver import warm_up

    hand = HandModel.default()
    for method in methods:
        threads = 2 if METHODS[method].takes_threads and surface == "spheres" else 1
        warm_up(hand, SolverOptions(method=method, surface=surface, threads=threads))


def triangles() -> None:
    """What the ticks of all methods that take a mesh run on it, and beside bodies on joints that are driven."""
    from hhsim.hand.model import HandModel
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.solver import warm_up

    ticks("coupled", "progressive", surface="mesh")
    warm_up(HandModel.default(), SolverOptions(surface="mesh"), jointed=True)


def both(mesh: Mesh, free: Any = None) -> None:
    """What two hands that meet run, beside a body of triangles that is fixed or free; on spheres the soak has them."""
    from free_scenes import far_hand

    from hhsim.hand.configuration import HandConfiguration
    from hhsim.hand.model import SIDES, HandModel
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.solver import Solver
    from hhsim.solver.workspace import TickWorkspace
    from hhsim.trees.contact_surface import contact_surface

    touched, far = contact_surface("mesh", mesh, triangle_tree(mesh, 1)), HandConfiguration(*far_hand(1))
    spaces = [TickWorkspace(HandModel.default(side), touched, SolverOptions(surface="mesh")) for side in SIDES]
    Solver(spaces, [] if free is None else [free]).solve(far, far)


def free() -> None:
    """What a free object's ticks run on triangles; on spheres only the soak has them."""
    from free_scenes import body_of, box

    from hhsim.hand.model import HandModel
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.solver import warm_up

    mesh, options = box((0.05, 0.05, 0.05)), SolverOptions(surface="mesh")
    block = body_of(mesh)
    warm_up(HandModel.default(), options, block)
    both(mesh, block)
    both(mesh)
    sessions(mesh=mesh, free={}, options=options)


def phases() -> None:
    """A tick phase by phase, its program solved by another solver."""
    from hhsim.hand.model import HandModel
    from hhsim.solver.options import SolverOptions
    from hhsim.solver.solver import warm_up

    warm_up(HandModel.default(), SolverOptions(qp="clarabel"))


def sessions(**changes: Any) -> None:
    """A session's loop: the compiled one, and what Python calls in its place or where a tick is missed."""
    from live_scripted import FakeClock, InStep, Moment, ScriptedGlove, make_setup

    from hhsim.kernels.live.deadlines import cause_of
    from hhsim.live.session.memory import SessionMemory
    from hhsim.live.session.setup import SafetyLimits

    cause_of(1, 0, 0, 0, 0)
    setup, clock = make_setup(safety=SafetyLimits(watchdog=False), duration=2e-3, **changes), FakeClock()
    memory = SessionMemory.create(bodies=setup.recorded_bodies)
    both = InStep(setup, memory, ScriptedGlove(clock, [Moment(0.0)]), clock)
    both.loop.prepare()
    both.run()


def first() -> None:
    """What ticks run on spheres, and then beside free bodies of triangles, whose own code the second one has made."""
    ticks("coupled", "progressive", "paper", "penalty")
    phases()
    sessions()
    free()


def second() -> None:
    """What ticks run on triangles, beside bodies that are fixed and driven, and what makes scenes."""
    triangles()
    trees()


PARTS = {"first": first, "second": second}

if __name__ == "__main__":
    sys.path.append(str(Path(__file__).resolve().parent.parent))  # of the tools that tests use
    if len(sys.argv) > 1:
        gc.disable()  # a third of the time, in a process that soon ends
        PARTS[sys.argv[1]]()
    else:
        running = [subprocess.Popen([sys.executable, __file__, part]) for part in PARTS]
        sys.exit(max(process.wait() for process in running))
