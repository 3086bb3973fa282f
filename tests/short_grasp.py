"""A short grasp of a simple object that several test modules replay, so that it is written down once."""

from functools import cache
from pathlib import Path
from typing import Any

from msgspec import structs

from hhsim.hand.model import HandModel, Side
from hhsim.mesh.catalogue import load_object
from hhsim.motion.trajectory import Trajectory
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Scene, make_scene
from hhsim.scene.script import Script, parse_script
from hhsim.solver.options import SolverOptions
from hhsim.trees.cache import cached_sphere_tree
from hhsim.trees.options import TreeOptions

APPROACH, CLOSING = 0.05, 0.1
"""Before the hold [s]."""


def short_grasp_text(hold: float = 0.05, release: float = 0.0) -> str:
    """A hand that comes from 5 mm, closes and holds, so long [s]; with a release, it opens again."""
    phases = {"approach": APPROACH, "grasp": CLOSING, "hold": hold, "release": release}
    tables = [f'[[phase]]\nname = "{name}"\nduration = {seconds}\n' for name, seconds in phases.items() if seconds]
    return 'title = "short"\npalm_gap = 0.005\ndepth = 0.015\n' + "".join(tables)


@cache
def short_grasp(hold: float = 0.05, release: float = 0.0) -> Script:
    """The same, read."""
    return parse_script(short_grasp_text(hold, release), name="short", where="short")


def shortened(script: Script, duration: float) -> Script:
    """A script whose phases all take the same share less, so that it lasts so long [s]."""
    share = duration / script.duration
    return structs.replace(script, phases=tuple(structs.replace(p, duration=share * p.duration) for p in script.phases))


def hurried(motion: str, duration: float) -> Script:
    """A script of the catalogue that lasts so long [s]; the other name says that it is not the catalogue's own."""
    return structs.replace(shortened(load_script(motion), duration), name="hurried")


@cache
def short_scene(script: Script, object_name: str = "cylinder", level: int = 2, side: Side = "right") -> Scene:
    """A script with an object of the catalogue, by a tree of a level that is built in no time."""
    mesh = load_object(object_name).mesh
    tree = cached_sphere_tree(mesh, TreeOptions(level=level))
    return make_scene(mesh, tree, HandModel.default(side), script)


def with_motion(scene: Scene, motion: Script | Trajectory, **options: Any) -> Scene:
    """The thing and the hand of a scene, in another motion."""
    thing = scene.solids[0]
    return make_scene(thing.placed_mesh, thing.placed_tree, scene.hands[0].model, motion, **options)


def result_of(scene: Scene, path: Path, description: dict[str, Any] | None = None, **options: Any) -> Result:
    """A scene replayed into a file."""
    replay_scene(scene, SolverOptions(**options), path, description=description)
    return load_result(path)


def short_result(path: Path, script: Script | None = None, *, object_name: str = "cylinder", **options: Any) -> Result:
    """The scene of a script, a short grasp if none is given, replayed into a file."""
    return result_of(short_scene(script or short_grasp(), object_name), path, {"hand_file": None}, **options)
