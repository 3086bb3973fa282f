"""Hand as rigid bodies and hinges, for any engine: a palm that the user pulls, and fifteen capsules that bend.

The coupling G of Eq. 1 is a spring and a damper between haptic and graphic hand: at rest, and without friction, an
engine then solves for the same hand as hhsim's own methods. Bodies have the virtual mass G τ², so that one time τ tunes
everything: the free hand returns to the user's as exp(-t/τ), critically damped.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.errors import InputError
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.hand.quaternion import quaternion_from_matrix
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import as_argument
from hhsim.kernels.rotation import rotation_vector_between
from hhsim.mesh.mesh import Mesh
from hhsim.solver.options import Stiffness
from hhsim.solver.outside_method import MethodScene

PALM = PALM_BODY
"""Number of the palm among the bodies; phalanx k of finger f is 3 f + k."""
PHALANX_MASS = 1e-3
"""Mass of a phalanx itself [kg]: engines need some; its resistance is the virtual inertia of its joint."""


def lack_of(extra: str, *modules: str) -> str:
    """Return a line about the first module that is not installed, with the extra of hhsim that brings it; else ""."""
    for module in modules:
        if find_spec(module) is None:
            return f"needs {module}, which is not installed: pip install 'hhsim[{extra}]'"
    return ""


def object_mesh(method: str, scene: MethodScene) -> Mesh:
    """Return the mesh of a scene's object; InputError if it is spheres alone."""
    if scene.mesh is None:
        raise InputError(f"method {method} needs the object's mesh, and it is spheres alone")
    return scene.mesh


@dataclass(frozen=True, eq=False)
class RigidHand:
    """Bodies and joints of a hand, in the palm's frame.

    A finger's frame has x along the straight finger, y along the axis about which a positive angle flexes, z out of its
    back; an abduction turns it about z. Phalanx k begins at its hinge, about y, and runs along x.
    """

    base: FloatArray  # first joint of each finger [m], shape (5, 3)
    frame: FloatArray  # palm from finger frame at zero abduction, shape (5, 3, 3)
    abduction_sign: float  # +1 where a positive abduction is a positive turn about z
    length: FloatArray  # of the capsules' axes [m], shape (5, 3)
    radius: FloatArray  # of the capsules [m], shape (5, 3): the mean of the cone's two ends
    limits: FloatArray  # least and most flexion [rad], shape (5, 3, 2)
    palm_center: FloatArray  # spheres of the palm [m], shapes (P, 3) and (P,)
    palm_radius: FloatArray
    mass: float  # of the palm [kg]
    inertia: float  # of the palm about its origin, the same about every axis [kg m²]
    armature: float  # inertia of each hinge [kg m²]
    stiffness: tuple[float, ...]  # k_t [N/m], k_r [N·m/rad] and k_θ [N·m/rad] of the coupling
    damping: tuple[float, ...]  # of the same three, critical [N s/m, N·m s/rad]

    @classmethod
    def of(cls, hand: HandModel, stiffness: Stiffness, response: float) -> "RigidHand":
        """Return the hand with a coupling whose time constant τ is `response` [s]."""
        springs = (stiffness.translation, stiffness.rotation, stiffness.flexion)
        mass, inertia, armature = (response**2 * k for k in springs)
        return cls(
            base=hand.base.copy(),
            frame=np.stack([hand.distal, hand.flexion_axis, hand.dorsal], axis=2),
            abduction_sign=hand.abduction_sign,
            length=hand.length.copy(),
            radius=0.5 * (hand.radius[:, :-1] + hand.radius[:, 1:]),
            limits=np.stack([hand.flexion_min, hand.flexion_max], axis=2),
            palm_center=np.array(hand.palm_tree.leaf_center, np.float64),
            palm_radius=np.array(hand.palm_tree.leaf_radius, np.float64),
            mass=mass,
            inertia=inertia,
            armature=armature,
            stiffness=springs,
            damping=tuple(2.0 * response * k for k in springs),
        )

    def place(self, finger: int, k: int) -> FloatArray:
        """Return the origin of phalanx k in the frame of the one before it, or of its finger [m], shape (3,)."""
        return np.array([self.length[finger, k - 1] if k else 0.0, 0.0, 0.0])

    @cached_property
    def _frames(self) -> list[tuple[float, ...]]:
        return [tuple(map(float, quaternion)) for quaternion in quaternion_from_matrix(self.frame)]

    def mount(self, finger: int, abduction: float) -> tuple[float, float, float, float]:
        """Return the rotation from finger to palm frame at an abduction [rad], (w, x, y, z)."""
        w, x, y, z = self._frames[finger]
        half = 0.5 * self.abduction_sign * abduction
        c, s = math.cos(half), math.sin(half)
        return w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s


class HandSpeed(NamedTuple):
    """Speed of the palm [m/s, rad/s], world, shapes (3,), and of the flexion [rad/s], shape (5, 3)."""

    linear: FloatArray
    angular: FloatArray
    flexion: FloatArray


STILL = HandSpeed(np.zeros(3), np.zeros(3), np.zeros((5, PHALANX_COUNT)))


def speed_between(before: HandConfiguration, now: HandConfiguration, period: float) -> HandSpeed:
    """Return the mean speed between two ticks of a hand."""
    return HandSpeed(
        (now.position - before.position) / period,
        rotation_between(before.orientation, now.orientation) / period,
        (now.flexion - before.flexion) / period,
    )


def rotation_between(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the shortest rotation vector [rad], shape (3,), world, between two orientations (w, x, y, z)."""
    vector = np.empty(3)
    rotation_vector_between(as_argument(first), as_argument(second), vector)
    return vector
