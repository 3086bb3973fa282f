"""Hands and scenes as MJCF, the format of MuJoCo (mujoco.readthedocs.io), and hands as URDF (wiki.ros.org/urdf/XML)."""

from collections.abc import Iterable
from itertools import product
from xml.etree import ElementTree as Xml

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.exchange.hand_bodies import PALM, Capsule, HandBody, HandJoint, Inertial, hand_bodies
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.model import HandModel
from hhsim.trees.sphere_tree import SphereTree

LIMITS = {"effort": "10.0", "velocity": "100.0"}
"""Limits of a joint [N·m, rad/s], which URDF demands and hhsim's hand has not."""
KNUCKLE = Inertial(1e-4, np.zeros(3), 1e-8 * np.eye(3))
"""Smallest sound mass of the link between a finger's abduction and first flexion, which represents no body."""


def hand_mjcf(hand: HandModel) -> str:
    """Return the MJCF text of a hand, in m, rad and kg.

    The palm has a free joint `palm`, with position and orientation (w, x, y, z), world, in qpos; the hinges are named
    like the columns of a submission, and a site at each tip sphere's centre `thumb_tip`. The hand collides with usual
    contact bits, and not with itself. Capsules lie inside of a phalanx, by `hhsim.exchange.hand_bodies.STEP` at most.
    """
    model = Xml.Element("mujoco", model=f"{hand.side}_hand")
    Xml.SubElement(model, "compiler", angle="radian", autolimits="true")
    usual = Xml.SubElement(model, "default")
    # Contact bits that match all others and not their own: fingers pass through each other.
    Xml.SubElement(usual, "geom", contype="1", conaffinity="0")
    world = Xml.SubElement(model, "worldbody")
    placed: dict[str, Xml.Element] = {"": world}
    tips = {f"{finger}_{PHALANGES}": f"{finger}_tip" for finger in FINGERS}
    for body in hand_bodies(hand).bodies:
        element = Xml.SubElement(placed[body.parent], "body", name=body.name, pos=_numbers(body.offset))
        placed[body.name] = element
        _add_parts(element, body)
        if body.cone is not None and body.name in tips:
            Xml.SubElement(element, "site", name=tips[body.name], pos=_numbers(body.cone.end), size="0.001")
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def scene_mjcf(hand: HandModel, tree: SphereTree, pose: HandConfiguration, hand_file: str, mesh_file: str) -> str:
    """Return the MJCF text of a hand and a fixed object [m], world; keyframe `start` is the hand's first pose.

    The mesh is shown; the leaf spheres of its tree collide, since MuJoCo would take the mesh's convex hull. The files,
    that of `hand_mjcf` and the object's mesh, are beside this one.
    """
    model = Xml.Element("mujoco", model="scene")
    Xml.SubElement(model, "include", file=hand_file)
    # A shell has inertia even if the mesh is open.
    Xml.SubElement(Xml.SubElement(model, "asset"), "mesh", name="object", file=mesh_file, inertia="shell")
    body = Xml.SubElement(Xml.SubElement(model, "worldbody"), "body", name="object")
    seen = {"contype": "0", "conaffinity": "0", "group": "2"}
    touched = {"contype": "0", "conaffinity": "1", "group": "3"}
    Xml.SubElement(body, "geom", seen, name="object", type="mesh", mesh="object")
    for center, radius in zip(tree.leaf_center, tree.leaf_radius):
        Xml.SubElement(body, "geom", touched, type="sphere", pos=_numbers(center), size=_numbers([radius]))
    angles = hand_bodies(hand).angles(pose.flexion, pose.abduction).values()
    start = _numbers([*pose.position, *pose.orientation, *angles])
    Xml.SubElement(Xml.SubElement(model, "keyframe"), "key", name="start", qpos=start)
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def _add_parts(element: Xml.Element, body: HandBody) -> None:
    inertial, inertia = body.inertial, body.inertial.inertia
    if body.name == PALM:
        Xml.SubElement(element, "freejoint", name=PALM)
    for joint in body.joints:
        limits = _numbers((joint.lower, joint.upper))
        Xml.SubElement(element, "joint", name=joint.name, type="hinge", axis=_numbers(joint.axis), range=limits)
    Xml.SubElement(
        element,
        "inertial",
        pos=_numbers(inertial.center),
        mass=_numbers([inertial.mass]),
        fullinertia=_numbers(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]),
    )
    for shape in body.shapes:
        if shape.is_sphere:
            Xml.SubElement(element, "geom", type="sphere", pos=_numbers(shape.start), size=_numbers([shape.radius]))
        else:
            ends = _numbers((*shape.start, *shape.end))
            Xml.SubElement(element, "geom", type="capsule", fromto=ends, size=_numbers([shape.radius]))


def _numbers(values: ArrayLike | Iterable[float]) -> str:
    """Format numbers of an attribute in full precision, separated by spaces."""
    return " ".join(repr(float(value) + 0.0) for value in np.ravel(np.asarray(values)))


def hand_urdf(hand: HandModel) -> str:
    """Return the URDF text of a hand, in m, rad and kg.

    The root link is the palm, in its frame. A URDF joint has one axis, so each finger has a link `index_knuckle`
    without a shape between abduction and first flexion; the other links are named like the bodies of
    `hhsim.exchange.hand_bodies`, and a massless link at each tip sphere's centre `thumb_tip`. URDF has no capsules:
    each is a cylinder with a sphere at both ends. Leave collisions of the hand with itself off.
    """
    robot = Xml.Element("robot", name=f"{hand.side}_hand")
    bodies = hand_bodies(hand).bodies
    for body in bodies:
        parent, offset = body.parent, body.offset
        for joint in body.joints[:-1]:
            knuckle = f"{body.name.rpartition('_')[0]}_knuckle"
            _add_link(robot, knuckle, KNUCKLE)
            _add_joint(robot, joint, parent, knuckle, offset)
            parent, offset = knuckle, np.zeros(3)
        link = _add_link(robot, body.name, body.inertial)
        for shape, role in product(body.shapes, ("visual", "collision")):
            _add_shape(link, role, shape)
        if body.joints:
            _add_joint(robot, body.joints[-1], parent, body.name, offset)
    for body in bodies:
        finger, _, number = body.name.partition("_")
        if body.cone is not None and number == str(PHALANGES):
            tip = f"{finger}_tip"
            Xml.SubElement(robot, "link", name=tip)
            fixed = Xml.SubElement(robot, "joint", name=f"{tip}_fixed", type="fixed")
            _connect(fixed, body.name, tip, body.cone.end)
    Xml.indent(robot)
    return Xml.tostring(robot, encoding="unicode") + "\n"


def _add_link(robot: Xml.Element, name: str, inertial: Inertial) -> Xml.Element:
    link = Xml.SubElement(robot, "link", name=name)
    part = Xml.SubElement(link, "inertial")
    Xml.SubElement(part, "origin", xyz=_numbers(inertial.center))
    Xml.SubElement(part, "mass", value=_numbers([inertial.mass]))
    pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    Xml.SubElement(part, "inertia", {name: _numbers([inertial.inertia[place]]) for name, place in pairs.items()})
    return link


def _add_shape(link: Xml.Element, role: str, shape: Capsule) -> None:
    radius = _numbers([shape.radius])
    for center in (shape.start,) if shape.is_sphere else (shape.start, shape.end):
        part = Xml.SubElement(link, role)
        Xml.SubElement(part, "origin", xyz=_numbers(center))
        Xml.SubElement(Xml.SubElement(part, "geometry"), "sphere", radius=radius)
    if not shape.is_sphere:
        part = Xml.SubElement(link, role)
        along = shape.end - shape.start
        length = float(np.linalg.norm(along))
        # Roll, pitch and yaw [rad] from z, the axis of a cylinder.
        x, y, z = along / length
        turn = _numbers([0.0, np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)])
        Xml.SubElement(part, "origin", xyz=_numbers(0.5 * (shape.start + shape.end)), rpy=turn)
        Xml.SubElement(Xml.SubElement(part, "geometry"), "cylinder", radius=radius, length=_numbers([length]))


def _add_joint(robot: Xml.Element, joint: HandJoint, parent: str, child: str, offset: FloatArray) -> None:
    element = Xml.SubElement(robot, "joint", name=joint.name, type="revolute")
    _connect(element, parent, child, offset)
    Xml.SubElement(element, "axis", xyz=_numbers(joint.axis))
    limits = {"lower": _numbers([joint.lower]), "upper": _numbers([joint.upper])}
    Xml.SubElement(element, "limit", {**limits, **LIMITS})


def _connect(element: Xml.Element, parent: str, child: str, offset: FloatArray) -> None:
    Xml.SubElement(element, "parent", link=parent)
    Xml.SubElement(element, "child", link=child)
    Xml.SubElement(element, "origin", xyz=_numbers(offset))
