"""Scenes of submissions: the words that each is made by, its digest, its bodies, and the scene as MJCF.

A submission names its scene by a digest of what poses depend on; the sphere tree is no part of it. MJCF is the format
of MuJoCo (mujoco.readthedocs.io): hand, bodies with masses and joints, table.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple
from xml.etree import ElementTree as Xml

import numpy as np

from hhsim.arrays import AnyArray, FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.mesh.mesh import Mesh
from hhsim.motion.trajectory import Phase, TickInput, Trajectory
from hhsim.scene.body import Body, Free
from hhsim.scene.described_scene import LoadedWords, SceneWords, load_words
from hhsim.scene.scene import Scene
from hhsim.solver.free_object import FreeObject
from hhsim.solver.scene_solver import seen_scene
from hhsim.submissions.hand_mjcf import Inertial, add_inertial, hand_bodies, numbers
from hhsim.system.settings_file import typed
from hhsim.trees.contact_surface import encloses
from hhsim.trees.sphere_tree import SphereTree

ROUNDED = 9
"""Decimals of m and rad in the digest: other machines round the last bits of a motion differently."""
NAMES = ("object", "trajectory", "unit", "size_mm", "level", "hand", "rate", "samples", "seed", "free")
"""Words that `hhsim scene` makes a scene by, so that it can be made again for a submission."""

OBJECT = "object"
"""Name of the one body of a scene of one object."""


def scene_digest(scene: Scene) -> str:
    """Return the SHA-256 [hex] of bodies, hands, motions and rate, numbers rounded to `ROUNDED` decimals."""
    seen, bodies = seen_scene(scene), scene_bodies(scene)
    parts: list[AnyArray] = [seen.mesh.vertices, seen.mesh.faces]
    for hand, haptic in zip((each.model for each in scene.hands), seen.haptic):
        parts += [hand.base, hand.distal, hand.dorsal, hand.length, hand.radius]
        parts += [hand.flexion_min, hand.flexion_max, hand.abduction_min, hand.abduction_max]
        parts += [hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius, *haptic]
    digest = hashlib.sha256(f"{' '.join(hand.model.side for hand in scene.hands)} {scene.ticks.rate!r} ".encode())
    if len(bodies) > 1 or bodies[0].free:
        digest.update(json.dumps([body.to_json() for body in bodies]).encode())
        parts += [part for body in bodies for part in (body.mesh.vertices, body.mesh.faces)]
        parts += recorded_poses(scene).values()
    for part in parts:
        # Adding 0 makes a plain zero of a negative one.
        rounded = np.ascontiguousarray(np.round(np.asarray(part, dtype="<f8"), ROUNDED) + 0.0)
        digest.update(f"{rounded.shape} ".encode() + rounded.tobytes())
    return digest.hexdigest()


def scene_names(scene: Scene) -> dict[str, Any]:
    """Return the words that the scene is made by; a scene that a program put together may lack some of `NAMES`."""
    hand = scene.hands[0].model.side if len(scene.hands) == 1 else "both"
    said = {**scene.description, "hand": hand, "rate": scene.ticks.rate}
    return {name: said[name] for name in NAMES if said.get(name) is not None}


def scene_title(names: Mapping[str, Any]) -> str:
    """Return object and motion, for messages."""
    return f"{names.get('object', 'an object')} {names.get('trajectory', 'and a motion')}"


def named_scene(names: Mapping[str, Any]) -> Scene:
    """Make the scene of `scene_names` again; raise InputError for unknown names or wrong values."""
    try:
        words = typed({**names, "place_object": "recorded"}, SceneWords, "made_by")
    except InputError as error:
        raise InputError(f"made_by is {json.dumps(dict(names))} ({error})") from error
    return worded_scene(load_words(words))


def worded_scene(loaded: LoadedWords) -> Scene:
    """Make the scene of words, described so that `scene_names` has them: its trees are those of the level they state.

    Errors as `hhsim.scene.described_scene.load_words`.
    """
    scene, words = loaded.placed().scene, loaded.words
    stated: dict[str, Any] = {"level": words.level or loaded.bodies.level}
    stated |= {} if words.free is None else {"free": words.free.given()}
    return replace(scene, description={**scene.description, **stated})


def tick_trajectory(ticks: TickInput, **about: Any) -> Trajectory:
    """Return the ticks as a motion with a sample a tick; `about` are the other fields of `Trajectory`."""
    last = ticks.tick_count - 1
    phases = tuple(
        Phase(phase.name, float(ticks.time[phase.first_tick]), float(ticks.time[min(phase.last_tick + 1, last)]))
        for phase in ticks.phases
    )
    return Trajectory(ticks.time, *HandConfiguration.of(ticks), phases=phases, **about)


class SceneBody(NamedTuple):
    """Rigid body of a scene; mesh and tree [m] are in its frame, beside a free one the world's at the first tick."""

    name: str
    mesh: Mesh
    tree: SphereTree
    pose: FloatArray | None = None  # first position [m] and orientation of one that moves as recorded, (7,)
    free: FreeObject | None = None  # physical properties of one of several bodies, some of them free
    fixed: bool = True  # False for one that moves

    def to_json(self) -> dict[str, Any]:
        """Return the name and the physical properties as plain values."""
        return {**({} if self.free is None else self.free.to_json() | {"fixed": self.fixed}), "name": self.name}


def recorded_poses(scene: Scene) -> dict[str, FloatArray]:
    """Return position [m] and orientation at each tick, (T, 7), of driven bodies, by name."""
    if (parts := seen_scene(scene).parts) is None:
        return {}
    driven = {name: np.hstack([motion.shift, motion.turn]) for name, motion in parts.driven.items()}
    return driven if parts.free else dict(zip(parts.names, parts.path.swapaxes(0, 1)))


def scene_bodies(scene: Scene) -> list[SceneBody]:
    """Return the one body as the object, or several bodies."""
    seen, first = seen_scene(scene), {name: poses[0] for name, poses in recorded_poses(scene).items()}
    if (parts := seen.parts) is None:
        return [SceneBody(OBJECT, seen.mesh, seen.tree, free=seen.free, fixed=seen.free is None)]
    others = {body.name: (free, fixed) for free, fixed, body in seen.others}
    shapes = zip(parts.names, parts.meshes, parts.trees)
    return [SceneBody(*shape, first.get(shape[0]), *others.get(shape[0], (seen.free, False))) for shape in shapes]


def hand_prefixes(scene: Scene) -> tuple[str, ...]:
    """Return what precedes the names of each hand's files, bodies and joints: of two their sides."""
    return ("",) if len(scene.hands) == 1 else tuple(f"{hand.model.side}_" for hand in scene.hands)


def free_bodies(scene: Scene) -> dict[str, Body]:
    """Return the bodies whose poses a submission has, by the names of their meshes."""
    return {
        OBJECT if len(scene.solids) == 1 else body.name: body for body in scene.solids if isinstance(body.motion, Free)
    }


def scene_mjcf(scene: Scene) -> str:
    """Return the MJCF text of a scene [m], world; keyframe `start` is the hand's first pose.

    The mesh of each body is shown, and in `NAME.obj`. Convex ones of several collide as meshes, others as leaf
    spheres, since MuJoCo would take the hull. A driven body is a mocap body; one on a joint is in the body that bears
    it, and they do not collide. Raises InputError for a body with a name of the hand's.
    """
    model = Xml.Element("mujoco", model="scene")
    for prefix in hand_prefixes(scene):
        Xml.SubElement(model, "include", file=f"{prefix}hand.xml")
    assets, world, contact = (Xml.SubElement(model, tag) for tag in ("asset", "worldbody", "contact"))
    bodies, taken, start = scene_bodies(scene), set[str](), list[float]()
    for prefix, each, haptic in zip(hand_prefixes(scene), scene.hands, seen_scene(scene).haptic, strict=True):
        hand, pose = hand_bodies(each.model), haptic.at(0)
        taken |= {f"{prefix}{one.name}" for one in hand.bodies} | {f"{prefix}{one.name}" for one in hand.joints}
        start += [*pose.position, *pose.orientation, *hand.angles(pose.flexion, pose.abduction).values()]
    for body in bodies:
        if body.name in taken:
            raise InputError(f"'{body.name}' is a body or a joint of the hand, too; expected another name")
        # A shell has inertia even if the mesh is open.
        Xml.SubElement(assets, "mesh", name=body.name, file=f"{body.name}.obj", inertia="shell")
    if first := bodies[0].free:
        Xml.SubElement(model, "option", gravity=numbers(first.gravity), timestep=numbers(1.0 / scene.ticks.rate))
        if first.table is not None:  # it stops bodies, not the hand
            table = {"type": "plane", "size": "0 0 0.1", "contype": "0", "conaffinity": "2"}
            Xml.SubElement(world, "geom", table, name="table plane", pos=numbers([0.0, 0.0, first.table]))
    _add_bodies(world, bodies, contact)
    values = {"freejoint": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), "joint": (0.0,)}
    start += [value for joint in world.iter() for value in values.get(joint.tag, ())]
    Xml.SubElement(Xml.SubElement(model, "keyframe"), "key", name="start", qpos=numbers(start))
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def _add_bodies(parent: Xml.Element, bodies: Sequence[SceneBody], contact: Xml.Element, bearer: str = "") -> None:
    """Add the bodies on a body, or in the world, and those on them."""
    for one in bodies:
        free, joint, still = one.free, one.free.joint if one.free else None, one.fixed or one.pose is not None
        if (joint.on if joint else "") != bearer:
            continue
        body = Xml.SubElement(parent, "body", name=one.name)
        if one.pose is not None:
            body.attrib |= {"mocap": "true", "pos": numbers(one.pose[:3]), "quat": numbers(one.pose[3:])}
        if free is not None:
            add_inertial(body, Inertial(free.mass, np.array(free.center), np.array(free.inertia)))
        if free is not None and joint is not None and joint.limits != (0.0, 0.0):  # MuJoCo takes no joint without range
            said = {"axis": numbers(joint.direction), "frictionloss": numbers([joint.friction])}
            said |= {"type": "slide"} if free.hinge is None else {"type": "hinge", "pos": numbers(free.hinge.origin)}
            said |= {"range": numbers(joint.limits)} if joint.limits else {}
            Xml.SubElement(body, "joint", said, name=one.name)
        elif joint is None and not still:
            Xml.SubElement(body, "freejoint", name=one.name)
        if bearer:
            Xml.SubElement(contact, "exclude", body1=bearer, body2=one.name)
        _add_shape(body, one)
        _add_bodies(body, bodies, contact, one.name)


def _add_shape(body: Xml.Element, one: SceneBody) -> None:
    """Add the mesh, which is shown, and what collides with the hand; of several also with bodies and table."""
    from scipy.spatial import ConvexHull

    touched = {"contype": "0", "conaffinity": "1"}
    if one.free is not None:
        friction, condim = numbers([one.free.friction, one.free.torsion, 0.0]), "4" if one.free.torsion else "3"
        touched = {"contype": "2", "conaffinity": "3", "priority": "1", "condim": condim, "friction": friction}
    convex = (one.pose is not None or one.free is not None) and encloses(one.mesh)
    convex = convex and bool(np.isclose(ConvexHull(one.mesh.vertices).volume, one.mesh.volume, rtol=1e-6))
    seen = touched if convex else {"contype": "0", "conaffinity": "0"}
    Xml.SubElement(body, "geom", seen, group="2", name=one.name, type="mesh", mesh=one.name)
    for center, radius in () if convex else zip(one.tree.leaf_center, one.tree.leaf_radius):
        Xml.SubElement(body, "geom", touched, group="3", type="sphere", pos=numbers(center), size=numbers([radius]))
