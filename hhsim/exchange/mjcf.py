"""Hands and scenes as MJCF, the format of MuJoCo (its XML reference: mujoco.readthedocs.io)."""

from collections.abc import Iterable
from xml.etree import ElementTree as Xml

import numpy as np
from numpy.typing import ArrayLike

from hhsim.exchange.hand_bodies import PALM, HandBodies, HandBody, hand_bodies
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.model import HandModel
from hhsim.trees.sphere_tree import SphereTree


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
    add_hand(world, hand_bodies(hand))
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def scene_mjcf(hand: HandModel, tree: SphereTree, pose: HandConfiguration, hand_file: str, mesh_file: str) -> str:
    """Return the MJCF text of a hand and a fixed object; keyframe `start` is the hand's first pose.

    The mesh is shown; the leaf spheres of its tree collide, since MuJoCo would take the mesh's convex hull.

    Args:
        tree: Sphere tree of the object [m], world.
        pose: First pose of the hand.
        hand_file: File of `hand_mjcf` beside this one.
        mesh_file: Mesh of the object [m], world, beside this one.
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
        Xml.SubElement(body, "geom", touched, type="sphere", pos=numbers(center), size=numbers([radius]))
    angles = hand_bodies(hand).angles(pose.flexion, pose.abduction).values()
    start = numbers([*pose.position, *pose.orientation, *angles])
    Xml.SubElement(Xml.SubElement(model, "keyframe"), "key", name="start", qpos=start)
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def add_hand(world: Xml.Element, bodies: HandBodies) -> None:
    """Add the bodies of a hand to the worldbody of a model."""
    placed: dict[str, Xml.Element] = {"": world}
    tips = {f"{finger}_{PHALANGES}": f"{finger}_tip" for finger in FINGERS}
    for body in bodies.bodies:
        element = Xml.SubElement(placed[body.parent], "body", name=body.name, pos=numbers(body.offset))
        placed[body.name] = element
        _add_parts(element, body)
        if body.cone is not None and body.name in tips:
            Xml.SubElement(element, "site", name=tips[body.name], pos=numbers(body.cone.end), size="0.001")


def _add_parts(element: Xml.Element, body: HandBody) -> None:
    inertial, inertia = body.inertial, body.inertial.inertia
    if body.name == PALM:
        Xml.SubElement(element, "freejoint", name=PALM)
    for joint in body.joints:
        limits = numbers((joint.lower, joint.upper))
        Xml.SubElement(element, "joint", name=joint.name, type="hinge", axis=numbers(joint.axis), range=limits)
    Xml.SubElement(
        element,
        "inertial",
        pos=numbers(inertial.center),
        mass=numbers([inertial.mass]),
        fullinertia=numbers(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]),
    )
    for shape in body.shapes:
        if shape.is_sphere:
            Xml.SubElement(element, "geom", type="sphere", pos=numbers(shape.start), size=numbers([shape.radius]))
        else:
            ends = numbers((*shape.start, *shape.end))
            Xml.SubElement(element, "geom", type="capsule", fromto=ends, size=numbers([shape.radius]))


def numbers(values: ArrayLike | Iterable[float]) -> str:
    """Format numbers of an attribute in full precision, separated by spaces."""
    return " ".join(repr(float(value) + 0.0) for value in np.ravel(np.asarray(values)))
