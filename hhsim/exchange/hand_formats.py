"""Hands as MJCF, the format of MuJoCo (mujoco.readthedocs.io), and as URDF (wiki.ros.org/urdf/XML)."""

from collections.abc import Iterable
from itertools import product
from xml.etree import ElementTree as Xml

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.exchange.hand_bodies import PALM, Capsule, HandJoint, Inertial, hand_bodies
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.model import HandModel

LIMITS = {"effort": "10.0", "velocity": "100.0"}
"""Limits of a joint [N·m, rad/s], which URDF demands and hhsim's hand has not."""
KNUCKLE = Inertial(1e-4, np.zeros(3), 1e-8 * np.eye(3))
"""Smallest sound mass of the link between a finger's abduction and first flexion, which represents no body."""


def hand_mjcf(hand: HandModel, prefix: str = "") -> str:
    """Return the MJCF text of a hand, in m, rad and kg.

    The palm has a free joint `palm`, with position and orientation (w, x, y, z), world, in qpos; the hinges are named
    like the columns of a submission, and a site at each tip sphere's centre `thumb_tip`. The hand collides with usual
    contact bits, and not with itself. Capsules lie inside of a phalanx, by `hhsim.exchange.hand_bodies.STEP` at most.
    A prefix precedes all names, where two hands are in one model.
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
        about = {"name": f"{prefix}{body.name}", "pos": numbers(body.offset), "gravcomp": "1"}
        element = Xml.SubElement(placed[body.parent], "body", about)
        placed[body.name] = element
        if body.name == PALM:
            Xml.SubElement(element, "freejoint", name=f"{prefix}{PALM}")
        for joint in body.joints:
            limits = numbers((joint.lower, joint.upper))
            about = {"name": f"{prefix}{joint.name}", "type": "hinge", "axis": numbers(joint.axis), "range": limits}
            Xml.SubElement(element, "joint", about)
        add_inertial(element, body.inertial)
        for shape in body.shapes:
            if shape.is_sphere:
                Xml.SubElement(element, "geom", type="sphere", pos=numbers(shape.start), size=numbers([shape.radius]))
            else:
                ends = numbers((*shape.start, *shape.end))
                Xml.SubElement(element, "geom", type="capsule", fromto=ends, size=numbers([shape.radius]))
        if body.cone is not None and body.name in tips:
            Xml.SubElement(element, "site", name=f"{prefix}{tips[body.name]}", pos=numbers(body.cone.end), size="0.001")
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def add_inertial(element: Xml.Element, of: Inertial) -> None:
    """Add mass properties to a body of MJCF."""
    inertia = numbers(of.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    Xml.SubElement(element, "inertial", pos=numbers(of.center), mass=numbers([of.mass]), fullinertia=inertia)


def numbers(values: ArrayLike | Iterable[float]) -> str:
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
    Xml.SubElement(part, "origin", xyz=numbers(inertial.center))
    Xml.SubElement(part, "mass", value=numbers([inertial.mass]))
    pairs = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    Xml.SubElement(part, "inertia", {name: numbers([inertial.inertia[place]]) for name, place in pairs.items()})
    return link


def _add_shape(link: Xml.Element, role: str, shape: Capsule) -> None:
    radius = numbers([shape.radius])
    for center in (shape.start,) if shape.is_sphere else (shape.start, shape.end):
        part = Xml.SubElement(link, role)
        Xml.SubElement(part, "origin", xyz=numbers(center))
        Xml.SubElement(Xml.SubElement(part, "geometry"), "sphere", radius=radius)
    if not shape.is_sphere:
        part = Xml.SubElement(link, role)
        along = shape.end - shape.start
        length = float(np.linalg.norm(along))
        # Roll, pitch and yaw [rad] from z, the axis of a cylinder.
        x, y, z = along / length
        turn = numbers([0.0, np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)])
        Xml.SubElement(part, "origin", xyz=numbers(0.5 * (shape.start + shape.end)), rpy=turn)
        Xml.SubElement(Xml.SubElement(part, "geometry"), "cylinder", radius=radius, length=numbers([length]))


def _add_joint(robot: Xml.Element, joint: HandJoint, parent: str, child: str, offset: FloatArray) -> None:
    element = Xml.SubElement(robot, "joint", name=joint.name, type="revolute")
    _connect(element, parent, child, offset)
    Xml.SubElement(element, "axis", xyz=numbers(joint.axis))
    limits = {"lower": numbers([joint.lower]), "upper": numbers([joint.upper])}
    Xml.SubElement(element, "limit", {**limits, **LIMITS})


def _connect(element: Xml.Element, parent: str, child: str, offset: FloatArray) -> None:
    Xml.SubElement(element, "parent", link=parent)
    Xml.SubElement(element, "child", link=child)
    Xml.SubElement(element, "origin", xyz=numbers(offset))
