"""The hand as bodies and joints, as URDF, MJCF and rigid-body engines have them.

The frame of every body is that of its joint, and where all angles are zero it is turned as the palm's is: a body is
placed by an offset alone, and what rounds is the length of a phalanx times its direction, nothing else. Setting the
joints to a configuration's flexion and abduction puts the joint centres where `hhsim.hand.model.HandModel.joints` has
them.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.fingers import FINGERS, PHALANGES
from hhsim.hand.model import HandModel

PALM = "palm"
"""Name of the body that all others hang on: its origin and its frame are the palm's."""
STEP = 5e-4
"""Between the radii of two capsules that stand for a tapering phalanx [m]: none of its surface is farther inside."""
DENSITY = 1000.0
"""Of the hand [kg/m³]: hhsim's hand has no mass, and engines want one."""


@dataclass(frozen=True)
class HandJoint:
    """A hinge.

    Attributes:
        name: As the column of a submission, without its unit: `index_abd`, `index_flex1`.
        axis: Unit vector about which a positive angle turns, shape (3,), frame of the body.
        lower, upper: Limits [rad].
    """

    name: str
    axis: FloatArray
    lower: float
    upper: float


@dataclass(frozen=True)
class Capsule:
    """A capsule, or a sphere where both ends are the same [m]; frame of the body.

    Attributes:
        start, end: Centres of its ends, shape (3,).
        radius: Of both.
    """

    start: FloatArray
    end: FloatArray
    radius: float

    @property
    def is_sphere(self) -> bool:
        """Whether it has no length."""
        return bool((self.start == self.end).all())


@dataclass(frozen=True)
class RoundCone:
    """A phalanx as hhsim has it: the hull of two spheres [m]; frame of the body, `start` is its origin.

    Attributes:
        end: Centre of the sphere at the next joint or the tip, shape (3,).
        start_radius, end_radius: Of the two.
    """

    end: FloatArray
    start_radius: float
    end_radius: float

    def capsules(self, step: float = STEP) -> list[Capsule]:
        """Capsules and a sphere inside of the round cone; `step` [m] bounds how far its surface is off theirs.

        One capsule where both radii are equal.
        """
        origin, taper = np.zeros(3), self.start_radius - self.end_radius
        if taper <= 0.0:
            return [Capsule(origin, self.end, self.end_radius)]
        pieces = int(np.ceil(taper / step))
        # Each has the smaller radius of its two ends: its spheres lie in those of the cone.
        share = np.arange(pieces + 1) / pieces
        parts = [
            Capsule(share[i] * self.end, share[i + 1] * self.end, self.start_radius - share[i + 1] * taper)
            for i in range(pieces)
        ]
        return [Capsule(origin, origin, self.start_radius), *parts]


@dataclass(frozen=True)
class Inertial:
    """Mass properties.

    Attributes:
        mass: [kg].
        center: Of mass [m], shape (3,), frame of the body.
        inertia: About the centre, axes of the body's frame [kg·m²], shape (3, 3).
    """

    mass: float
    center: FloatArray
    inertia: FloatArray


@dataclass(frozen=True)
class HandBody:
    """One rigid body.

    Attributes:
        name: `palm`, or finger and number of the phalanx: `index_1`.
        parent: Name of the body that it hangs on; "" for the palm.
        offset: Its origin in the parent's frame [m], shape (3,).
        joints: In the order in which they turn it, the one next to the parent first; none for the palm, which is free.
        shapes: What collides.
        inertial: Its mass.
        cone: Of a phalanx, what the shapes stand for; None for the palm, whose spheres are its own.
    """

    name: str
    parent: str
    offset: FloatArray
    joints: tuple[HandJoint, ...]
    shapes: tuple[Capsule, ...]
    inertial: Inertial
    cone: RoundCone | None = None


@dataclass(frozen=True)
class HandBodies:
    """All bodies, a parent before what hangs on it.

    Attributes:
        bodies: The palm, then the phalanges, finger by finger, proximal to distal.
    """

    bodies: tuple[HandBody, ...]

    @cached_property
    def joints(self) -> tuple[HandJoint, ...]:
        """All joints in their order: abduction and three flexions a finger, 20 in all."""
        return tuple(joint for body in self.bodies for joint in body.joints)

    def angles(self, flexion: FloatArray, abduction: FloatArray) -> dict[str, float]:
        """The angle of each joint [rad] by name, for flexion, shape (5, 3), and abduction, shape (5,)."""
        found = {}
        for f, finger in enumerate(FINGERS):
            found[f"{finger}_abd"] = float(abduction[f])
            found |= {f"{finger}_flex{k + 1}": float(flexion[f, k]) for k in range(PHALANGES)}
        return found


def hand_bodies(hand: HandModel) -> HandBodies:
    """The bodies and joints of a hand."""
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
    # Tetrahedra from the origin to each face: their volumes, and what they weigh at their centres.
    volume = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6.0
    center = (volume[:, None] * corners.sum(axis=1) / 4.0).sum(axis=0) / volume.sum()
    mass = DENSITY * float(volume.sum())
    square = np.ptp(hand.palm_mesh.vertices, axis=0) ** 2
    inertia = mass / 12.0 * np.diag(square.sum() - square)
    return HandBody(PALM, "", np.zeros(3), (), shapes, Inertial(mass, center, inertia))


def _of_cone(cone: RoundCone) -> Inertial:
    """Those of the cylinder of its mean radius."""
    length, radius = float(np.linalg.norm(cone.end)), 0.5 * (cone.start_radius + cone.end_radius)
    mass = DENSITY * np.pi * radius**2 * length
    along = np.outer(cone.end, cone.end) / length**2
    across = mass * (0.25 * radius**2 + length**2 / 12.0)
    return Inertial(mass, 0.5 * cone.end, across * (np.eye(3) - along) + 0.5 * mass * radius**2 * along)
