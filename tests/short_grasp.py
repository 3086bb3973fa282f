"""A grasp of a cylinder in a fifth of a second, objects that swing beside it, scenes cut short, and their results."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs

from hhsim.arrays import FloatArray
from hhsim.hand.model import HandModel, Side
from hhsim.hand.quaternion import quaternion
from hhsim.mesh.catalogue import load_object
from hhsim.motion.trajectory import ObjectMotion, RigidMotion, Trajectory
from hhsim.replay.replay import replay_scene
from hhsim.result.reader import Result, load_result
from hhsim.scene.body import Body, Driven
from hhsim.scene.motion_catalogue import load_script
from hhsim.scene.scene import Hand, Scene, make_scene
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


def swing(time: FloatArray, speed: float = 3.0, turning: float = 20.0) -> RigidMotion:
    """A rigid motion that reaches these speeds [m/s, rad/s], and begins in the world's frame."""
    slow, quick = 2.0 * np.pi * 0.7, 2.0 * np.pi * 1.1
    axis = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])
    angle = turning / slow * np.sin(slow * time)
    way = speed / quick * np.sin(quick * time)
    return RigidMotion(quaternion(angle[:, None] * axis), way[:, None] * np.array([0.6, 0.0, 0.8]))


def carried(motion: Trajectory, by: RigidMotion) -> Trajectory:
    """The hand and the object of a motion, both moved."""
    count = motion.sample_count
    place = np.tile(motion.object_position, (count, 1)), np.tile(motion.object_orientation, (count, 1))
    return replace(
        motion,
        position=by.points(motion.position),
        orientation=by.orientations(motion.orientation),
        object_motion=ObjectMotion(by.points(place[0]), by.orientations(place[1])),
    )


def swung_result(scene: Scene, path: Path) -> Result:
    """A scene of one thing that stands still, replayed into a file while hand and thing are swung about."""
    motion = scene.hands[0].trajectory
    return result_of(with_motion(scene, carried(motion, swing(motion.time))), path)


def cut(scene: Scene, bodies: slice) -> Scene:
    """Return the first ticks of the hands beside bodies that move from their places as in other ticks."""
    cut_bodies = []
    for body in scene.bodies:
        if isinstance(body, Body) and isinstance(body.motion, Driven):
            poses, values = body.motion.poses.at(bodies), body.motion.values
            motion = Driven(poses, None if values is None else values[bodies])
            joint = body.joint
            if joint is not None and values is not None:
                joint = structs.replace(joint, start=float(values[bodies][0]))
            body = replace(body, motion=motion, joint=joint)
        cut_bodies.append(body)
    count = len(range(*bodies.indices(scene.ticks.tick_count)))
    hands = tuple(replace(hand, ticks=hand.ticks.first(count)) for hand in scene.hands)
    description = {**scene.description, "trajectory": f"{scene.description.get('trajectory')}, cut"}
    return replace(scene, hands=hands, bodies=tuple(cut_bodies), description=description)


def moved_hand(scene: Scene, hand: int, **changed: object) -> Scene:
    """Return a scene with other arrays of the ticks of a hand."""
    hands: list[Hand] = list(scene.hands)
    hands[hand] = replace(hands[hand], ticks=replace(hands[hand].ticks, **changed))  # type: ignore[arg-type]
    return replace(scene, hands=tuple(hands))
