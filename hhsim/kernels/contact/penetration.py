"""Penetration depth of stored hands at each tick, independent of the solver.

The paper (Section V-D) defines it as the biggest penetration between the graphic finger and the object's spheres in a
cycle; here the palm counts too. Phalanges are placed by their stored joints.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.contact.surface import cone_distance
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Array, jit_allocating
from hhsim.kernels.round_cone_distance import RoundCone, cone_slope, sphere_cone
from hhsim.kernels.sphere_tree import STACK_SIZE


class HandSurface(NamedTuple):
    """Surface of the hand."""

    phalanx_radius: Array  # at each joint and at the tip, not growing towards the tip [m], (5, 4)
    palm_x: Array  # centres of the palm's spheres [m], palm frame, (P,)
    palm_y: Array
    palm_z: Array
    palm_radius: Array  # [m], (P,)


class PlacedHands(NamedTuple):
    """Poses of hands at each tick, world."""

    joints: Array  # joint centres and tip sphere centre [m], (T, 5, 4, 3)
    position: Array  # palm origin [m], (T, 3)
    rotation: Array  # palm to world, (T, 3, 3)


@jit_allocating
def clearances(
    surface: Any, shape: HandSurface, placed: PlacedHands, limit: float, palm_out: Array, finger_out: Array
) -> None:
    """Compute the least signed distance [m] of the palm, (T,), and of each finger, (T, 5), to the object's surface.

    Negative inside, `limit` [m] from there on, NaN if the palm's pose or a joint is.
    """
    joints, palm_x, palm_y, palm_z = placed.joints, shape.palm_x, shape.palm_y, shape.palm_z
    stack = np.empty(STACK_SIZE, dtype=np.int64)
    for tick in range(joints.shape[0]):
        p, r = placed.position[tick], placed.rotation[tick]
        best = limit
        for i in range(palm_x.shape[0]):
            x = p[0] + r[0, 0] * palm_x[i] + r[0, 1] * palm_y[i] + r[0, 2] * palm_z[i]
            y = p[1] + r[1, 0] * palm_x[i] + r[1, 1] * palm_y[i] + r[1, 2] * palm_z[i]
            z = p[2] + r[2, 0] * palm_x[i] + r[2, 1] * palm_y[i] + r[2, 2] * palm_z[i]
            if math.isnan(x + y + z):
                best = np.nan
                break
            best = cone_distance(surface, sphere_cone(x, y, z, shape.palm_radius[i]), best, stack)
        palm_out[tick] = best
        for f in range(FINGER_COUNT):
            best = limit
            for k in range(PHALANX_COUNT):
                a, b = joints[tick, f, k], joints[tick, f, k + 1]
                ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
                length = math.sqrt(ux * ux + uy * uy + uz * uz)
                if math.isnan(length):
                    best = np.nan
                    break
                radius, tip_radius = shape.phalanx_radius[f, k], shape.phalanx_radius[f, k + 1]
                tan_slope, inverse_length = cone_slope(length, radius, tip_radius)
                cone = RoundCone(
                    a[0],
                    a[1],
                    a[2],
                    ux * inverse_length,
                    uy * inverse_length,
                    uz * inverse_length,
                    length,
                    tan_slope,
                    inverse_length,
                    radius,
                    radius - tip_radius,
                )
                best = cone_distance(surface, cone, best, stack)
            finger_out[tick, f] = best
