"""hhsim: benchmark and trajectory replay for virtual-hand haptics.

Units are SI everywhere (m, rad, s, N, N·m); the world is right-handed with z up.

What a program needs first is here by name, and is imported when it is first asked for::

    import hhsim

    scene = hhsim.open_scene("cube", "pinch")
    hhsim.replay_scene(scene, hhsim.SolverOptions(method="coupled"), "pinch.h5")
    result = hhsim.load_result("pinch.h5")
    force = result["force/total"][result.phase("hold")]

Everything else is in the modules, whose docstrings say what it takes and gives.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hhsim.errors import HhsimError
    from hhsim.hand import HandModel
    from hhsim.mesh import Mesh, load_mesh
    from hhsim.named_scene import open_scene
    from hhsim.replay import replay as replay_scene
    from hhsim.result import Result, load_result
    from hhsim.scene import Scene
    from hhsim.solver import HandSolver
    from hhsim.solver_options import SolverOptions, Stiffness
    from hhsim.trajectory import Trajectory
    from hhsim.trajectory_file import load_trajectory, save_trajectory
    from hhsim.verify import verify as verify_result

__version__ = "0.1.0"
__all__ = [
    "HandModel",
    "HandSolver",
    "HhsimError",
    "Mesh",
    "Result",
    "Scene",
    "SolverOptions",
    "Stiffness",
    "Trajectory",
    "load_mesh",
    "load_result",
    "load_trajectory",
    "open_scene",
    "replay_scene",
    "save_trajectory",
    "verify_result",
]
_PLACES = {
    "HandModel": "hhsim.hand.HandModel",
    "HandSolver": "hhsim.solver.HandSolver",
    "HhsimError": "hhsim.errors.HhsimError",
    "Mesh": "hhsim.mesh.Mesh",
    "Result": "hhsim.result.Result",
    "Scene": "hhsim.scene.Scene",
    "SolverOptions": "hhsim.solver_options.SolverOptions",
    "Stiffness": "hhsim.solver_options.Stiffness",
    "Trajectory": "hhsim.trajectory.Trajectory",
    "load_mesh": "hhsim.mesh.load_mesh",
    "load_result": "hhsim.result.load_result",
    "load_trajectory": "hhsim.trajectory_file.load_trajectory",
    "open_scene": "hhsim.named_scene.open_scene",
    "replay_scene": "hhsim.replay.replay",
    "save_trajectory": "hhsim.trajectory_file.save_trajectory",
    "verify_result": "hhsim.verify.verify",
}
"""Where each of these names is at home."""


def __getattr__(name: str) -> Any:
    """Import what is asked for: the command line and the kernels must not wait for what they do not use."""
    if name not in _PLACES:
        raise AttributeError(f"module 'hhsim' has no attribute '{name}'")
    module, _, attribute = _PLACES[name].rpartition(".")
    value = getattr(import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
