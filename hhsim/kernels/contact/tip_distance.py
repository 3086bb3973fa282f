"""Signed distance of each fingertip of the graphic hand, its distal phalanx, to the true mesh."""

import math

import numpy as np

from hhsim.kernels.contact.mesh_distance import DEEPEST_INTERVAL, AxisSearch, round_cone_mesh_distance
from hhsim.kernels.hand.hand_shape import StoredHands
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Array, jit_allocating
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh, signed_distance


@jit_allocating
def hand_tip_distances(hand: StoredHands, bvh: MeshBvh, limit: float, resolution: float, distance_out: Array) -> None:
    """Compute the signed distance [m] of each distal phalanx at each tick, shape (T, 5), at most `limit`.

    `resolution` [m] is that of `hand_mesh_distances`. A phalanx whose end is inside is not searched for its deepest
    point: its distance is that of the end's ball. NaN if its joints are.
    """
    radius, joints = hand.shape.phalanx_radius, hand.joints
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    work = AxisSearch(stack, stack_distance2, np.empty((2, DEEPEST_INTERVAL)))
    for tick in range(joints.shape[0]):
        for f in range(FINGER_COUNT):
            a, b = joints[tick, f, PHALANX_COUNT - 1], joints[tick, f, PHALANX_COUNT]
            first, last = radius[f, PHALANX_COUNT - 1], radius[f, PHALANX_COUNT]
            if math.isnan(a.sum() + b.sum()):
                distance_out[tick, f] = np.nan
                continue
            distance = signed_distance(bvh, b[0], b[1], b[2], stack, stack_distance2)[0] - last
            if distance >= 0.0:
                distance = round_cone_mesh_distance(bvh, a, b, first, last, limit, resolution, work)
            distance_out[tick, f] = distance
