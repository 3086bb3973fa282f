"""hhsim: benchmark and trajectory replay for virtual-hand haptics.

Units are SI everywhere (m, rad, s, N, N·m); the world is right-handed with z up. Names that most programs need are
here, and are imported at first use::

    import hhsim

    scene = hhsim.open_scene("cube", "pinch")
    hhsim.replay_scene(scene, hhsim.SolverOptions(method="coupled"), "pinch.h5")
    result = hhsim.load_result("pinch.h5")
    force = result["force/total"][result.phase("hold")]
    hhsim.draw(result, 1500)  # a picture, which a notebook shows

Everything else is in the modules, whose docstrings say what it takes and gives.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hhsim.errors import HhsimError
    from hhsim.hand.configuration import HandConfiguration
    from hhsim.hand.model import HandModel
    from hhsim.mesh.mesh import Mesh, load_mesh
    from hhsim.motion.file import load_trajectory, save_trajectory
    from hhsim.motion.trajectory import Trajectory
    from hhsim.repair.in_memory import repair
    from hhsim.replay.replay import replay_scene
    from hhsim.report.report import draw
    from hhsim.result.reader import Result, load_result
    from hhsim.scene.scene import Scene, open_scene
    from hhsim.solver.options import SolverOptions, Stiffness
    from hhsim.solver.outside_method import MethodScene, TickAnswer
    from hhsim.solver.solver import HandSolver
    from hhsim.verify.verify import verify as verify_result
    from hhsim.view.viewer import view_result

__version__ = "1.0.0"
__all__ = [
    "HandConfiguration",
    "HandModel",
    "HandSolver",
    "HhsimError",
    "Mesh",
    "MethodScene",
    "Result",
    "Scene",
    "SolverOptions",
    "Stiffness",
    "TickAnswer",
    "Trajectory",
    "draw",
    "load_mesh",
    "load_result",
    "load_trajectory",
    "open_scene",
    "repair",
    "replay_scene",
    "save_trajectory",
    "verify_result",
    "view_result",
]
_PLACES = {
    "HandConfiguration": "hhsim.hand.configuration.HandConfiguration",
    "HandModel": "hhsim.hand.model.HandModel",
    "HandSolver": "hhsim.solver.solver.HandSolver",
    "HhsimError": "hhsim.errors.HhsimError",
    "Mesh": "hhsim.mesh.mesh.Mesh",
    "MethodScene": "hhsim.solver.outside_method.MethodScene",
    "Result": "hhsim.result.reader.Result",
    "Scene": "hhsim.scene.scene.Scene",
    "SolverOptions": "hhsim.solver.options.SolverOptions",
    "Stiffness": "hhsim.solver.options.Stiffness",
    "TickAnswer": "hhsim.solver.outside_method.TickAnswer",
    "Trajectory": "hhsim.motion.trajectory.Trajectory",
    "draw": "hhsim.report.report.draw",
    "load_mesh": "hhsim.mesh.mesh.load_mesh",
    "load_result": "hhsim.result.reader.load_result",
    "load_trajectory": "hhsim.motion.file.load_trajectory",
    "open_scene": "hhsim.scene.scene.open_scene",
    "repair": "hhsim.repair",
    "replay_scene": "hhsim.replay.replay.replay_scene",
    "save_trajectory": "hhsim.motion.file.save_trajectory",
    "verify_result": "hhsim.verify.verify.verify",
    "view_result": "hhsim.view.viewer.view_result",
}
"""Full name of each of these."""


def __getattr__(name: str) -> Any:
    """Import a name at its first use, so that the command line and the kernels do not wait for the others."""
    if name not in _PLACES:
        raise AttributeError(f"module 'hhsim' has no attribute '{name}'")
    module, _, attribute = _PLACES[name].rpartition(".")
    # The package of the repair is called itself.
    value = import_module(_PLACES[name]) if module == "hhsim" else getattr(import_module(module), attribute)
    globals()[name] = value
    if "numba" in sys.modules:
        import_module("hhsim.system.compile_notice").log_compilation()
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
