"""The paper's frustum of a phalanx and a sphere's distance from it (Eq. 4 to 6), transcribed."""

import math
from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.hand.model import HandModel


class Frustum(NamedTuple):
    """The paper's symbols for a phalanx [m]: its thick bottom D, r₁, its thin one E, r₂."""

    d: FloatArray
    e: FloatArray
    r1: float
    r2: float


def frustum_of(hand: HandModel, joints: FloatArray, f: int, k: int) -> Frustum:
    """The cone between the circles where it touches the two joint spheres, constructed by their tangent."""
    a, b = joints[f, k], joints[f, k + 1]
    ra, rb = hand.radius[f, k], hand.radius[f, k + 1]
    u = (b - a) / np.linalg.norm(b - a)
    sine = (ra - rb) / np.linalg.norm(b - a)
    cosine = math.sqrt(1.0 - sine**2)
    return Frustum(a + ra * sine * u, b + rb * sine * u, ra * cosine, rb * cosine)


def frustum_excess(cone: Frustum, centers: FloatArray, radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    """|OC| - |OC|_Γ (Eq. 4, 5) and k (Eq. 6) of spheres, shapes (L,)."""
    de = cone.e - cone.d
    length = np.linalg.norm(de)
    distance = np.linalg.norm(np.cross(cone.d - centers, de), axis=1) / length
    k = (centers - cone.e) @ (cone.d - cone.e) / length**2
    phi = math.atan2(cone.r1 - cone.r2, length)
    return distance - (radius / math.cos(phi) + k * (cone.r1 - cone.r2) + cone.r2), k
