"""Scene as MJCF, the format of MuJoCo (mujoco.readthedocs.io): hand, object or things with masses and joints, table."""

from collections.abc import Sequence
from typing import Any, NamedTuple
from xml.etree import ElementTree as Xml

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.exchange.hand_bodies import Inertial, hand_bodies
from hhsim.exchange.hand_formats import add_inertial, numbers
from hhsim.hand.configuration import HandConfiguration
from hhsim.mesh.mesh import Mesh
from hhsim.scene.free_object import FreeObject
from hhsim.scene.scene import Scene
from hhsim.trees.contact_surface import encloses
from hhsim.trees.sphere_tree import SphereTree


class SceneBody(NamedTuple):
    """Rigid body of a scene; mesh and tree [m] are in its frame, of a thing the world's at the first tick."""

    name: str
    mesh: Mesh
    tree: SphereTree
    pose: FloatArray | None = None  # first position [m] and orientation of one that moves as recorded, (7,)
    free: FreeObject | None = None  # physical properties of one of several things
    fixed: bool = True  # False for a thing that moves

    def to_json(self) -> dict[str, Any]:
        """Return the name, and the physical properties of a thing, as plain values."""
        return {**({} if self.free is None else self.free.to_json() | {"fixed": self.fixed}), "name": self.name}


def recorded_poses(scene: Scene) -> dict[str, FloatArray]:
    """Return position [m] and orientation at each tick, (T, 7), of parts and things that move as recorded, by name."""
    if (parts := scene.parts) is None:
        return {}
    driven = {name: np.hstack([motion.shift, motion.turn]) for name, motion in parts.driven.items()}
    return driven if parts.free else dict(zip(parts.names, parts.path.swapaxes(0, 1)))


def scene_bodies(scene: Scene) -> list[SceneBody]:
    """Return the one object, the parts of a thing, or several things."""
    parts, first = scene.parts, {name: poses[0] for name, poses in recorded_poses(scene).items()}
    if parts is None:
        return [SceneBody("object", scene.mesh, scene.tree)]
    others = {one.name: (one.free, one.fixed) for one in scene.others}
    shapes = zip(parts.names, parts.meshes, parts.trees)
    return [SceneBody(*shape, first.get(shape[0]), *others.get(shape[0], (scene.free, False))) for shape in shapes]


def scene_mjcf(scene: Scene) -> str:
    """Return the MJCF text of a scene [m], world; keyframe `start` is the hand's first pose.

    The mesh of each body is shown, and in `NAME.obj`. Convex parts and things collide as meshes, others and the object
    as leaf spheres, since MuJoCo would take the hull. What moves as recorded is a mocap body; a thing on a joint
    is in the body that bears it, and they do not collide. Raises InputError for a thing with a name of the hand's.
    """
    model = Xml.Element("mujoco", model="scene")
    Xml.SubElement(model, "include", file="hand.xml")
    assets, world, contact = (Xml.SubElement(model, tag) for tag in ("asset", "worldbody", "contact"))
    bodies, hand, pose = scene_bodies(scene), hand_bodies(scene.hand), HandConfiguration.of(scene.ticks).at(0)
    for body in bodies:
        if body.name in {one.name for one in hand.bodies} | {one.name for one in hand.joints}:
            raise InputError(f"'{body.name}' is a body or a joint of the hand, too; expected another name of the thing")
        # A shell has inertia even if the mesh is open.
        Xml.SubElement(assets, "mesh", name=body.name, file=f"{body.name}.obj", inertia="shell")
    if first := bodies[0].free:
        Xml.SubElement(model, "option", gravity=numbers(first.gravity), timestep=numbers(1.0 / scene.ticks.rate))
        if first.table is not None:  # it stops things, not the hand
            table = {"type": "plane", "size": "0 0 0.1", "contype": "0", "conaffinity": "2"}
            Xml.SubElement(world, "geom", table, name="table plane", pos=numbers([0.0, 0.0, first.table]))
    _add_bodies(world, bodies, contact)
    start = [*pose.position, *pose.orientation, *hand.angles(pose.flexion, pose.abduction).values()]
    values = {"freejoint": (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), "joint": (0.0,)}
    start += [value for joint in world.iter() for value in values.get(joint.tag, ())]
    Xml.SubElement(Xml.SubElement(model, "keyframe"), "key", name="start", qpos=numbers(start))
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def _add_bodies(parent: Xml.Element, bodies: Sequence[SceneBody], contact: Xml.Element, bearer: str = "") -> None:
    """Add the bodies on a thing, or in the world, and those on them."""
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
    """Add the mesh, which is shown, and what collides with the hand; of a thing with things and the table, too."""
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
