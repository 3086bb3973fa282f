"""Hand that is written to a recording: recorded joints that move with our hand's bones, and balls that fill its bodies.

Balls 0 to 15 S - 1 lie on the axes of the phalanges, S on each at equal shares from its first joint to its last, finger
by finger; the others are the palm's spheres.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.arithmetic import sine_cosine
from hhsim.kernels.contact.mesh_distance import DEEPEST_INTERVAL, AxisSearch, round_cone_mesh_distance
from hhsim.kernels.hand.kinematics import FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Array, Triple, jit, jit_allocating, jit_inline
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh, signed_distance
from hhsim.kernels.rotation import quaternion_to_matrix, turned, turned_back

PHALANGES = FINGER_COUNT * PHALANX_COUNT


class HandBones(NamedTuple):
    """Directions and sizes of a hand in the palm's frame."""

    distal: Array  # unit direction of each straight finger, (5, 3)
    across: Array  # axis about which a positive angle bends it, (5, 3)
    dorsal: Array  # unit direction out of its back, (5, 3)
    abduction_sign: float
    radius: Array  # at each joint and at the tip [m], (5, 4)
    palm_center: Array  # of the palm's spheres [m], (P, 3)
    palm_radius: Array  # [m], (P,)


@jit
def place_bones(hand: HandBones, orientation: Array, flexion: Array, abduction: Array, frames_out: Array) -> None:
    """Compute the frames of the palm and of 15 phalanges in T hands, world, shape (T, 16, 3, 3).

    Quaternions are (T, 4), flexions [rad] (T, 5, 3), abductions (T, 5). Columns of a phalanx's frame are its axis, its
    flexion axis and their cross product; those of the palm its own axes.
    """
    for t in range(orientation.shape[0]):
        palm = frames_out[t, 0]
        quaternion_to_matrix(orientation[t], palm)
        for f in range(FINGER_COUNT):
            sine, cosine = sine_cosine(hand.abduction_sign * abduction[t, f])
            d, a, w = hand.distal[f], hand.across[f], hand.dorsal[f]
            fx, fy, fz = cosine * d[0] + sine * a[0], cosine * d[1] + sine * a[1], cosine * d[2] + sine * a[2]
            hx, hy, hz = turned(
                palm, cosine * a[0] - sine * d[0], cosine * a[1] - sine * d[1], cosine * a[2] - sine * d[2]
            )
            total = 0.0
            for k in range(PHALANX_COUNT):
                total += flexion[t, f, k]
                sine, cosine = sine_cosine(total)
                x, y, z = turned(palm, cosine * fx - sine * w[0], cosine * fy - sine * w[1], cosine * fz - sine * w[2])
                out = frames_out[t, 1 + PHALANX_COUNT * f + k]
                out[0, 0], out[1, 0], out[2, 0] = x, y, z
                out[0, 1], out[1, 1], out[2, 1] = hx, hy, hz
                out[0, 2], out[1, 2], out[2, 2] = y * hz - z * hy, z * hx - x * hz, x * hy - y * hx


@jit_inline
def _moved_with(after: Array, before: Array, x: float, y: float, z: float) -> Triple:
    """Return a vector that turns with a bone, from its frame before to its frame after."""
    x, y, z = turned_back(before, x, y, z)
    return turned(after, x, y, z)


@jit
def move_joints(joints: Array, origin: Array, before: Array, position: Array, frames: Array, joints_out: Array) -> None:
    """Move T hands of 21 joints [m], shape (T, 21, 3), with their bones, each of which keeps its length.

    Palm origins before and after [m] have shape (T, 3), frames of the bones before and after (T, 16, 3, 3).
    """
    for t in range(joints.shape[0]):
        own, out, o, p = joints[t], joints_out[t], origin[t], position[t]
        for f in range(FINGER_COUNT + 1):
            first = 0 if f == FINGER_COUNT else 1 + 4 * f
            x, y, z = own[first, 0] - o[0], own[first, 1] - o[1], own[first, 2] - o[2]
            x, y, z = _moved_with(frames[t, 0], before[t, 0], x, y, z)
            out[first, 0], out[first, 1], out[first, 2] = x + p[0], y + p[1], z + p[2]
            for k in range(PHALANX_COUNT if f < FINGER_COUNT else 0):
                j, bone = first + k, 1 + PHALANX_COUNT * f + k
                x, y, z = own[j + 1, 0] - own[j, 0], own[j + 1, 1] - own[j, 1], own[j + 1, 2] - own[j, 2]
                x, y, z = _moved_with(frames[t, bone], before[t, bone], x, y, z)
                out[j + 1, 0], out[j + 1, 1], out[j + 1, 2] = out[j, 0] + x, out[j, 1] + y, out[j, 2] + z


@jit
def fill_with_balls(
    hand: HandBones, joints: Array, position: Array, frames: Array, shares: Array, points_out: Array, motion_out: Array
) -> None:
    """Compute the centres of the balls of one hand [m], (n, 3), and their derivatives by a change, (n, 3, 26).

    Joints and tips [m] have shape (5, 4, 3), the palm's origin [m] (3,), frames (16, 3, 3); shares of an axis (S,).
    """
    count, palm = shares.shape[0], frames[0]
    for i in range(points_out.shape[0]):
        point, motion = points_out[i], motion_out[i]
        for j in range(3):
            for k in range(motion.shape[1]):
                motion[j, k] = 0.0
            motion[j, j] = 1.0
        body = i // count
        if body < PHALANGES:
            f, k = body // PHALANX_COUNT, body % PHALANX_COUNT
            share = shares[i - count * body]
            for j in range(3):
                point[j] = joints[f, k, j] + share * (joints[f, k + 1, j] - joints[f, k, j])
            for bent in range(k + 1):
                axis = frames[1 + PHALANX_COUNT * f + bent]
                column = 6 + PHALANX_COUNT * f + bent
                _turning(axis[0, 1], axis[1, 1], axis[2, 1], point, joints[f, bent], motion, column)
            w, sign = hand.dorsal[f], hand.abduction_sign
            x, y, z = turned(palm, sign * w[0], sign * w[1], sign * w[2])
            _turning(x, y, z, point, joints[f, 0], motion, 6 + PHALANGES + f)
        else:
            c = hand.palm_center[i - count * PHALANGES]
            x, y, z = turned(palm, c[0], c[1], c[2])
            point[0], point[1], point[2] = position[0] + x, position[1] + y, position[2] + z
        _turning(1.0, 0.0, 0.0, point, position, motion, 3)
        _turning(0.0, 1.0, 0.0, point, position, motion, 4)
        _turning(0.0, 0.0, 1.0, point, position, motion, 5)


@jit_inline
def _turning(x: float, y: float, z: float, point: Array, origin: Array, motion_out: Array, column: int) -> None:
    """Write the derivative of a point by a turn about an axis (x, y, z) through an origin."""
    dx, dy, dz = point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]
    motion_out[0, column] = y * dz - z * dy
    motion_out[1, column] = z * dx - x * dz
    motion_out[2, column] = x * dy - y * dx


@jit_allocating
def balls_are_clear(
    bvh: MeshBvh, points: Array, radii: Array, least: Array, share: int, clearance: float, finest: float
) -> bool:
    """Return True if all balls, and the round cones that they fill, are this far from a mesh [m].

    `least` has lower bounds of the balls' distances [m], (n,), which spare what is far; `share` is the number of balls
    of an axis. Pieces of `finest` [m] are not halved any more, as in `round_cone_mesh_distance`.
    """
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    work = AxisSearch(stack, stack_distance2, np.empty((2, DEEPEST_INTERVAL)))
    phalanges = share * PHALANGES
    for i in range(phalanges, points.shape[0]):
        p = points[i]
        # A lower bound spares the search.
        far = least[i] >= clearance
        if not far and signed_distance(bvh, p[0], p[1], p[2], stack, stack_distance2)[0] - radii[i] < clearance:
            return False
    for i in range(phalanges):
        if (i + 1) % share == 0:
            continue
        a, b = points[i], points[i + 1]
        x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        # Between two balls the distance changes by no more than the axis's length and the radii's drop together.
        slope = math.sqrt(x * x + y * y + z * z) + abs(radii[i] - radii[i + 1])
        far = 0.5 * (least[i] + least[i + 1] - slope) >= clearance
        if not far and round_cone_mesh_distance(bvh, a, b, radii[i], radii[i + 1], clearance, finest, work) < clearance:
            return False
    return True
