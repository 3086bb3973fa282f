"""Hands as rigid bodies and joints in MJCF, the format of MuJoCo (mujoco.readthedocs.io).

The frame of every body has its origin at its joint, and the palm's axes where all angles are zero. With a
configuration's flexion and abduction the joint centres are those of `hhsim.hand.model.HandModel.joints`.
"""

from collections.abc import Iterable, Iterator
from itertools import pairwise
from xml.etree import ElementTree as Xml

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.model import HandModel

PALM = "palm"
"""Name of the root body, in the palm frame."""
JOINTS = tuple(f"{finger}_{joint}" for finger in FINGERS for joint in ("abd", "flex1", "flex2", "flex3"))
"""Hinges, in the order of `joint_angles`; the columns of a submission have their names, too."""
BODIES = (PALM, *(f"{finger}_{k}" for finger in FINGERS for k in (1, 2, 3)))
"""Bodies of a hand."""
STEP = 5e-4
"""Step of the radii of the capsules in a tapering phalanx [m], and bound of their distance to its surface."""
DENSITY = 1000.0
"""Density of the hand for engines [kg/m³]; hhsim's hand has no mass."""


Inertial = tuple[float, FloatArray, FloatArray]
"""Mass [kg], centre of mass (3,) [m] and inertia about it (3, 3) [kg·m²], in the frame of the body."""


def joint_angles(flexion: FloatArray, abduction: FloatArray) -> list[float]:
    """Return the angles of `JOINTS` [rad], for flexion, shape (5, 3), and abduction, shape (5,)."""
    return [float(angle) for angle in np.column_stack([abduction, flexion]).ravel()]


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

    def body(
        parent: Xml.Element, name: str, offset: FloatArray, inertial: Inertial, joints: Iterable[Xml.Element]
    ) -> Xml.Element:
        element = Xml.SubElement(parent, "body", name=f"{prefix}{name}", pos=numbers(offset), gravcomp="1")
        element.extend(joints)
        add_inertial(element, inertial)
        return element

    free = Xml.Element("freejoint", name=f"{prefix}{PALM}")
    palm = body(Xml.SubElement(model, "worldbody"), PALM, np.zeros(3), _of_palm(hand), [free])
    for center, radius in zip(hand.palm_tree.leaf_center, hand.palm_tree.leaf_radius):
        Xml.SubElement(palm, "geom", type="sphere", pos=numbers(center), size=numbers([radius]))

    def hinge(name: str, axis: FloatArray, *limits: FloatArray) -> Xml.Element:
        return Xml.Element(
            "joint", name=f"{prefix}{name}", type="hinge", axis=numbers(axis), range=numbers(np.array(limits))
        )

    for f, finger in enumerate(FINGERS):
        spread = hand.abduction_sign * hand.dorsal[f], hand.abduction_min[f], hand.abduction_max[f]
        joints, parent, offset = [hinge(f"{finger}_abd", *spread)], palm, hand.base[f]
        for k in range(PHALANGES):
            bend = hand.flexion_axis[f], hand.flexion_min[f, k], hand.flexion_max[f, k]
            end, *radii = hand.length[f, k] * hand.distal[f], float(hand.radius[f, k]), float(hand.radius[f, k + 1])
            joints = [*joints, hinge(f"{finger}_flex{k + 1}", *bend)]
            parent = body(parent, f"{finger}_{k + 1}", offset, _of_cone(end, *radii), joints)
            for start, stop, radius in capsules(end, *radii):
                if (start == stop).all():
                    Xml.SubElement(parent, "geom", type="sphere", pos=numbers(start), size=numbers([radius]))
                else:
                    ends = numbers((*start, *stop))
                    Xml.SubElement(parent, "geom", type="capsule", fromto=ends, size=numbers([radius]))
            joints, offset = [], end
        Xml.SubElement(parent, "site", name=f"{prefix}{finger}_tip", pos=numbers(offset), size="0.001")
    Xml.indent(model)
    return Xml.tostring(model, encoding="unicode") + "\n"


def capsules(end: FloatArray, start_radius: float, end_radius: float) -> Iterator[tuple[FloatArray, FloatArray, float]]:
    """Yield capsules and a sphere inside of a phalanx, at most `STEP` from its surface: both ends, and the radius [m].

    It is the hull of spheres at the origin and at `end` (3,) [m].
    """
    origin, taper = np.zeros(3), start_radius - end_radius
    if taper <= 0.0:
        yield origin, end, end_radius
        return
    yield origin, origin, start_radius
    # The smaller radius of each piece's ends, so that it lies in the cone.
    share = np.linspace(0.0, 1.0, int(np.ceil(taper / STEP)) + 1)
    for first, last in pairwise(share):
        yield first * end, last * end, start_radius - last * taper


def _of_palm(hand: HandModel) -> Inertial:
    corners = hand.palm_mesh.vertices[hand.palm_mesh.faces]
    # Volumes of the tetrahedra from the origin to each face, weighted at their centres.
    volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    center = (volume[:, None] * corners.sum(axis=1) / 4.0).sum(axis=0) / volume.sum()
    mass = DENSITY * float(volume.sum())
    square = np.ptp(hand.palm_mesh.vertices, axis=0) ** 2
    return mass, center, mass / 12.0 * np.diag(square.sum() - square)


def _of_cone(end: FloatArray, start_radius: float, end_radius: float) -> Inertial:
    """Return the mass properties of the cylinder of the cone's mean radius."""
    length, radius = float(np.linalg.norm(end)), 0.5 * (start_radius + end_radius)
    mass = DENSITY * np.pi * radius**2 * length
    along = np.outer(end, end) / length**2
    across = mass * (0.25 * radius**2 + length**2 / 12.0)
    return mass, 0.5 * end, across * (np.eye(3) - along) + 0.5 * mass * radius**2 * along


def add_inertial(element: Xml.Element, of: Inertial) -> None:
    """Add mass properties to a body of MJCF."""
    mass, center, inertia = of
    full = numbers(inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
    Xml.SubElement(element, "inertial", pos=numbers(center), mass=numbers([mass]), fullinertia=full)


def numbers(values: ArrayLike | Iterable[float]) -> str:
    """Format numbers of an attribute in full precision, separated by spaces."""
    return " ".join(repr(float(value) + 0.0) for value in np.ravel(np.asarray(values)))
