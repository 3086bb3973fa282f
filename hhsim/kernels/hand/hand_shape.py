"""Sizes of a hand of which positions are stored, and its bodies as round cones."""

import math
from typing import NamedTuple

from hhsim.kernels.jit import Array, jit
from hhsim.kernels.round_cone_distance import RoundCone, cone_slope


class HandShape(NamedTuple):
    """Sizes of a hand [m]: phalanx_radius (5, 4); palm_center (P, 3), palm frame, and palm_radius (P,)."""

    phalanx_radius: Array
    palm_center: Array
    palm_radius: Array


class StoredHands(NamedTuple):
    """A hand at T ticks, world: joints (T, 5, 4, 3) and the palm's position (T, 3) [m] and rotation (T, 3, 3)."""

    shape: HandShape
    joints: Array
    position: Array
    rotation: Array


@jit
def stored_phalanx(shape: HandShape, joints: Array, finger: int, phalanx: int) -> RoundCone:
    """Return a phalanx as a round cone, from joints [m], shape (5, 4, 3), world; not a number where they are not."""
    a, b = joints[finger, phalanx], joints[finger, phalanx + 1]
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = math.sqrt(x * x + y * y + z * z)
    radius, tip_radius = shape.phalanx_radius[finger, phalanx], shape.phalanx_radius[finger, phalanx + 1]
    slope, inverse = cone_slope(length, radius, tip_radius)
    ux, uy, uz = x * inverse, y * inverse, z * inverse
    return RoundCone(a[0], a[1], a[2], ux, uy, uz, length, slope, inverse, radius, radius - tip_radius)
