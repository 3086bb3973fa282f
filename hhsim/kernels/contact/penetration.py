"""Penetration depth of stored hands at each tick, independent of the solver.

The paper (Section V-D) defines it as the biggest penetration between the graphic finger and the object's spheres in a
cycle; here the palm counts too. Phalanges are placed by their stored joints.
"""

import math
from typing import Any

import numpy as np

from hhsim.kernels.contact.surface import cone_distance
from hhsim.kernels.hand.hand_shape import StoredHands, stored_phalanx
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT, placed_sphere
from hhsim.kernels.jit import Array, jit_allocating
from hhsim.kernels.sphere_tree import STACK_SIZE


@jit_allocating
def clearances(surface: Any, hand: StoredHands, limit: float, palm_out: Array, finger_out: Array) -> None:
    """Compute the least signed distances [m] of palm, (T,), and fingers, (T, 5), up to `limit`; NaN for a bad pose."""
    shape, joints, position, rotation = hand
    stack = np.empty(STACK_SIZE, dtype=np.int64)
    for tick in range(joints.shape[0]):
        best = limit
        for i in range(shape.palm_radius.shape[0]):
            c = shape.palm_center[i]
            sphere = placed_sphere(position[tick], rotation[tick], c[0], c[1], c[2], shape.palm_radius[i])
            if math.isnan(sphere.x + sphere.y + sphere.z):
                best = np.nan
                break
            best = cone_distance(surface, sphere, best, stack)
        palm_out[tick] = best
        for f in range(FINGER_COUNT):
            best = limit
            for k in range(PHALANX_COUNT):
                cone = stored_phalanx(shape, joints[tick], f, k)
                if math.isnan(cone.length):
                    best = np.nan
                    break
                best = cone_distance(surface, cone, best, stack)
            finger_out[tick, f] = best
