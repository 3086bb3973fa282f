"""Short runs with a free object: shared by the tests of its figures and of the referee."""

from dataclasses import replace
from pathlib import Path

from short_grasp import short_grasp, short_scene

from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.free_object import FreeObject
from hhsim.scene.scene import Scene
from hhsim.solver.options import SolverOptions


def free_scene(mass: float = 50.0, friction: float = 2.0) -> Scene:
    """A cylinder that is too heavy and too rough to go far, on a table, grasped."""
    scene = short_scene(short_grasp(hold=0.09))
    table = float(scene.mesh.bounds[0, 2])
    return replace(scene, free=FreeObject.of_mesh(scene.mesh, mass=mass, friction=friction, torsion=0.01, table=table))


def free_result(path: Path) -> Result:
    """That replayed into a file, on the triangles themselves."""
    replay_scene(free_scene(), SolverOptions(surface="mesh"), path, description={"hand_file": None})
    return load_result(path)
