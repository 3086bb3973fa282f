"""Hands as rigid bodies and joints, and as MJCF, the format of MuJoCo (mujoco.readthedocs.io).

The frame of every body has its origin at its joint, and the palm's axes where all angles are zero. With a
configuration's flexion and abduction the joint centres are those of `hhsim.hand.model.HandModel.joints`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from xml.etree import ElementTree as Xml

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.model import HandModel

PALM = "palm"
"""Name of the root body, in the palm frame."""
STEP = 5e-4
"""Step of the radii of the capsules in a tapering phalanx [m], and bound of their distance to its surface."""
DENSITY = 1000.0
"""Density of the hand for engines [kg/m³]; hhsim's hand has no mass."""


@dataclass(frozen=True)
class HandJoint:
    """Hinge of a body, named as the column of a submission without its unit: `index_abd`, `index_flex1`.

    A positive angle turns about `axis`, unit, shape (3,), frame of the body; the limits are in rad.
    """

    name: str
    axis: FloatArray
    lower: float
    upper: float


@dataclass(frozen=True)
class Capsule:
    """Capsule, or a sphere if both ends are equal, by its ends' centres (3,) and radius [m]; frame of the body."""

    start: FloatArray
    end: FloatArray
    radius: float

    @property
    def is_sphere(self) -> bool:
        """True if it has no length."""
        return bool((self.start == self.end).all())


@dataclass(frozen=True)
class RoundCone:
    """Shape of a phalanx: hull of spheres at the body's origin and at `end` (3,), the next joint or the tip [m]."""

    end: FloatArray
    start_radius: float
    end_radius: float

    def capsules(self) -> list[Capsule]:
        """Return capsules and a sphere inside of the round cone, at most `STEP` from its surface."""
        origin, taper = np.zeros(3), self.start_radius - self.end_radius
        if taper <= 0.0:
            return [Capsule(origin, self.end, self.end_radius)]
        pieces = int(np.ceil(taper / STEP))
        # The smaller radius of each piece's ends, so that it lies in the cone.
        share = np.arange(pieces + 1) / pieces
        parts = [
            Capsule(share[i] * self.end, share[i + 1] * self.end, self.start_radius - share[i + 1] * taper)
            for i in range(pieces)
        ]
        return [Capsule(origin, origin, self.start_radius), *parts]


@dataclass(frozen=True)
class Inertial:
    """Mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg·m²], in the frame of the body."""

    mass: float
    center: FloatArray
    inertia: FloatArray


@dataclass(frozen=True)
class HandBody:
    """One rigid body."""

    name: str  # `palm`, or finger and number of the phalanx: `index_1`
    parent: str  # name of its parent; "" for the palm
    offset: FloatArray  # origin in the parent's frame [m], shape (3,)
    # Joints in the order in which they turn it, from the parent; none for the palm, which is free.
    joints: tuple[HandJoint, ...]
    shapes: tuple[Capsule, ...]  # collision shapes
    inertial: Inertial  # mass properties
    cone: RoundCone | None = None  # shape of a phalanx; None for the palm


@dataclass(frozen=True)
class HandBodies:
    """Bodies of a hand: the palm, then the phalanges, finger by finger, proximal to distal."""

    bodies: tuple[HandBody, ...]

    @cached_property
    def joints(self) -> tuple[HandJoint, ...]:
        """Joints: abduction and three flexions a finger, 20 in all."""
        return tuple(joint for body in self.bodies for joint in body.joints)

    def angles(self, flexion: FloatArray, abduction: FloatArray) -> dict[str, float]:
        """Return each joint's angle [rad] by name, for flexion, shape (5, 3), and abduction, shape (5,)."""
        values = np.column_stack([abduction, flexion]).ravel().tolist()
        return dict(zip((joint.name for joint in self.joints), values))


def hand_bodies(hand: HandModel) -> HandBodies:
    """Compute the bodies and joints of a hand."""
    bodies = [_palm(hand)]
    for f, finger in enumerate(FINGERS):
        limits = float(hand.abduction_min[f]), float(hand.abduction_max[f])
        spread = HandJoint(f"{finger}_abd", hand.abduction_sign * hand.dorsal[f], *limits)
        parent, offset = PALM, hand.base[f]
        for k in range(PHALANGES):
            limits = float(hand.flexion_min[f, k]), float(hand.flexion_max[f, k])
            bend = HandJoint(f"{finger}_flex{k + 1}", hand.flexion_axis[f], *limits)
            end = hand.length[f, k] * hand.distal[f]
            cone = RoundCone(end, float(hand.radius[f, k]), float(hand.radius[f, k + 1]))
            name, joints = f"{finger}_{k + 1}", (spread, bend) if k == 0 else (bend,)
            bodies.append(HandBody(name, parent, offset, joints, tuple(cone.capsules()), _of_cone(cone), cone))
            parent, offset = name, end
    return HandBodies(tuple(bodies))


def _palm(hand: HandModel) -> HandBody:
    tree = hand.palm_tree
    shapes = tuple(Capsule(center, center, float(radius)) for center, radius in zip(tree.leaf_center, tree.leaf_radius))
    corners = hand.palm_mesh.vertices[hand.palm_mesh.faces]
    # Volumes of the tetrahedra from the origin to each face, weighted at their centres.
    volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    center = (volume[:, None] * corners.sum(axis=1) / 4.0).sum(axis=0) / volume.sum()
    mass = DENSITY * float(volume.sum())
    square = np.ptp(hand.palm_mesh.vertices, axis=0) ** 2
    inertia = mass / 12.0 * np.diag(square.sum() - square)
    return HandBody(PALM, "", np.zeros(3), (), shapes, Inertial(mass, center, inertia))


def _of_cone(cone: RoundCone) -> Inertial:
    """Return the mass properties of the cylinder of the cone's mean radius."""
    length, radius = float(np.linalg.norm(cone.end)), 0.5 * (cone.start_radius + cone.end_radius)
    mass = DENSITY * np.pi * radius**2 * length
    along = np.outer(cone.end, cone.end) / length**2
    across = mass * (0.25 * radius**2 + length**2 / 12.0)
    return Inertial(mass, 0.5 * cone.end, across * (np.eye(3) - along) + 0.5 * mass * radius**2 * along)


def hand_mjcf(hand: HandModel, prefix: str = "") -> str:
    """Return the MJCF text of a hand, in m, rad and kg.

    The palm has a free joint `palm`, with position and orientation (w, x, y, z), world, in qpos; the hinges are named
    like the columns of a submission, and a site at each tip sphere's centre `thumb_tip`. The hand collides with usual
    contact bits, and not with itself. Capsules lie inside of a phalanx, by `hhsim.submissions.hand_mjcf.STEP` at most.
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
