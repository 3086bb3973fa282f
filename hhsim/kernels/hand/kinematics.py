"""Kinematics of the 21-DoF hand: a 6-DoF palm and five planar chains of three flexion joints.

Flexion angle θ curls a finger towards the palm. Abduction turns the whole finger about its dorsal axis towards the
thumb side; it comes from the glove and is not optimised (paper, Section III-B). Since the three flexion axes of a
finger are parallel, phalanx k points along cos(Θ) u - sin(Θ) w with Θ = θ_1 + ... + θ_k, u distal and w dorsal.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.arithmetic import sine_cosine
from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.jit import Array, Record, jit_allocating, jit_inline
from hhsim.kernels.rotation import turned_back
from hhsim.kernels.round_cone import RoundCone, sphere_cone

FINGER_COUNT = 5
PHALANX_COUNT = 3
BODY_COUNT = 16
PALM_BODY = 15
"""Bodies 0 to 14 are the phalanges, finger by finger, proximal to distal; body 15 is the palm."""
BOX_CORNERS = 8
DOF = 21
"""Palm translation [m] 0 to 2, palm rotation vector [rad] 3 to 5, flexion [rad] 6 + 3 finger + joint."""


@by_reference
class HandArrays(NamedTuple):
    """Hand as the kernels see it; palm frame."""

    base: Array  # first joint of each finger [m], (5, 3)
    distal: Array  # unit direction of the straight finger at zero abduction, (5, 3)
    dorsal: Array  # unit direction out of the finger's back, perpendicular to distal, (5, 3)
    abduction_sign: Array  # +1 if a positive turn about dorsal is towards the thumb (right hand), -1 left, (1,)
    length: Array  # distance between joint centres, the last one to the tip sphere's centre [m], (5, 3)
    radius: Array  # at each joint and at the tip, not growing towards the tip [m], (5, 4)
    tan_slope: Array  # with the next as of `kernels.round_cone.cone_slope`, (5, 3)
    inverse_length: Array  # (5, 3)
    flexion_min: Array  # joint limits [rad], (5, 3)
    flexion_max: Array
    reach: Array  # largest distance of an axis point of the phalanx from the palm's origin [m], (5, 3)
    lever: Array  # largest distance of an axis point of phalanx k from joint i [m], 0 for i > k, (5, 3, 3)
    turning_lever: Array  # [m], (16,): a body whose points move by d turns, across its axis, by d over this at most
    palm_x: Array  # centres of the leaf spheres of the palm's tree [m], (P,)
    palm_y: Array
    palm_z: Array
    palm_radius: Array  # [m], (P,)
    palm_group: Array  # spheres around groups of them: centres (3 rows) and radii [m], (4, G)
    palm_group_start: NDArray[np.int64]  # first sphere of each group, and the end, (G + 1,)
    palm_box: Array  # corners of the box around the centres [m], (8, 3)
    palm_reach: Array  # largest distance of a centre from the palm's origin [m], (1,)


@jit_inline
def phalanx_cone(hand: HandArrays, joints: Array, direction: Array, finger: int, phalanx: int) -> RoundCone:
    """Return a phalanx as a round cone, from joints [m], shape (5, 4, 3), and directions, (5, 3, 3), world."""
    a, u = joints[finger, phalanx], direction[finger, phalanx]
    length, radius = hand.length[finger, phalanx], hand.radius[finger, phalanx]
    slope, inverse = hand.tan_slope[finger, phalanx], hand.inverse_length[finger, phalanx]
    drop = radius - hand.radius[finger, phalanx + 1]
    return RoundCone(a[0], a[1], a[2], u[0], u[1], u[2], length, slope, inverse, radius, drop)


@jit_inline
def placed_sphere(position: Array, rotation: Array, x: float, y: float, z: float, radius: float) -> RoundCone:
    """Return a sphere of the palm frame [m] as a round cone, world."""
    return sphere_cone(
        position[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z,
        position[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z,
        position[2] + rotation[2, 0] * x + rotation[2, 1] * y + rotation[2, 2] * z,
        radius,
    )


@jit_inline
def seen_cone(frame: Record, cone: RoundCone) -> RoundCone:
    """Return a round cone in a frame, such as a pose's palm, which has position [m] and rotation."""
    r, p = frame.rotation, frame.position
    x, y, z = turned_back(r, cone.x - p[0], cone.y - p[1], cone.z - p[2])
    ux, uy, uz = turned_back(r, cone.ux, cone.uy, cone.uz)
    return RoundCone(x, y, z, ux, uy, uz, cone.length, cone.tan_slope, cone.inverse_length, cone.radius, cone.drop)


@jit_inline
def forward_kinematics(
    hand: HandArrays,
    position: Array,
    rotation: Array,
    flexion: Array,
    abduction: Array,
    joints_out: Array,
    direction_out: Array,
    axis_out: Array,
    abduction_axis_out: Array,
) -> None:
    """Compute the joints and axes of a hand, world.

    The palm has its origin at `position` [m] and turns palm to world by `rotation`, shape (3, 3); flexion [rad] has
    shape (5, 3), abduction (5,). Written are the joint centres and tip sphere centre [m], shape (5, 4, 3), and unit
    vectors: the axis of each phalanx, (5, 3, 3), the axis about which a positive angle flexes, and the one about which
    a positive abduction turns the finger, (5, 3).
    """
    sign = hand.abduction_sign[0]
    for f in range(FINGER_COUNT):
        ux, uy, uz = hand.distal[f, 0], hand.distal[f, 1], hand.distal[f, 2]
        wx, wy, wz = hand.dorsal[f, 0], hand.dorsal[f, 1], hand.dorsal[f, 2]
        # The flexion axis w × u turns u towards -w; abduction turns the pair (u, axis) in their own plane.
        ax, ay, az = wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux
        sine, cosine = sine_cosine(abduction[f])
        sine *= sign
        ux, ax = cosine * ux + sine * ax, cosine * ax - sine * ux
        uy, ay = cosine * uy + sine * ay, cosine * ay - sine * uy
        uz, az = cosine * uz + sine * az, cosine * az - sine * uz
        for i in range(3):
            r0, r1, r2 = rotation[i, 0], rotation[i, 1], rotation[i, 2]
            axis_out[f, i] = r0 * ax + r1 * ay + r2 * az
            abduction_axis_out[f, i] = sign * (r0 * wx + r1 * wy + r2 * wz)
            joints_out[f, 0, i] = position[i] + r0 * hand.base[f, 0] + r1 * hand.base[f, 1] + r2 * hand.base[f, 2]
        total = 0.0
        for k in range(PHALANX_COUNT):
            total += flexion[f, k]
            s, c = sine_cosine(total)
            dx, dy, dz = c * ux - s * wx, c * uy - s * wy, c * uz - s * wz
            length = hand.length[f, k]
            for i in range(3):
                d = rotation[i, 0] * dx + rotation[i, 1] * dy + rotation[i, 2] * dz
                direction_out[f, k, i] = d
                joints_out[f, k + 1, i] = joints_out[f, k, i] + length * d


@jit_inline
def coarse_bounds(hand: HandArrays, step: Array, abduction_step: Array, motion_out: Array) -> float:
    """Compute bounds as if all of a body's rotations were in one direction; return the largest."""
    shift = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    turn = math.sqrt(step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
    longest = motion_out[PALM_BODY] = shift + turn * hand.palm_reach[0]
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            motion = shift + turn * hand.reach[f, k] + abs(abduction_step[f]) * hand.lever[f, k, 0]
            for i in range(k + 1):
                motion += abs(step[6 + 3 * f + i]) * hand.lever[f, k, i]
            motion_out[3 * f + k] = motion
            longest = max(longest, motion)
    return longest


@jit_inline
def motion_bounds(
    hand: HandArrays, pose: Record, step: Array, abduction_step: Array, enough: float, motion_out: Array
) -> None:
    """Compute upper bounds [m] on the motion of any axis point of each body in a step, shape (16,).

    They hold at every instant of the motion, and in proportion for a share of the step (δp, δφ, δθ), shape (21,), and
    abduction step [rad], shape (5,). The pose at its start is up to date. With all rotations of a body in one direction
    a point moves by |δp| + Σ ω_i l_i, of angles ω and levers l: the coarse bound, kept if none exceeds `enough` [m].
    Otherwise a point moves, to first order, by no more than the ends of the axis, and beyond that by half the greatest
    acceleration, Σ ω_i l_i (ω_i + 2 Σ_{j<i} ω_j), joint by joint outwards.
    """
    if coarse_bounds(hand, step, abduction_step, motion_out) <= enough:
        return
    px, py, pz, wx, wy, wz = step[0], step[1], step[2], step[3], step[4], step[5]
    turn = math.sqrt(wx * wx + wy * wy + wz * wz)
    square = 0.0
    rotation, box = pose.rotation, hand.palm_box
    for i in range(BOX_CORNERS):
        x = rotation[0, 0] * box[i, 0] + rotation[0, 1] * box[i, 1] + rotation[0, 2] * box[i, 2]
        y = rotation[1, 0] * box[i, 0] + rotation[1, 1] * box[i, 1] + rotation[1, 2] * box[i, 2]
        z = rotation[2, 0] * box[i, 0] + rotation[2, 1] * box[i, 1] + rotation[2, 2] * box[i, 2]
        vx, vy, vz = px + wy * z - wz * y, py + wz * x - wx * z, pz + wx * y - wy * x
        square = max(square, vx * vx + vy * vy + vz * vz)
    bend = turn * turn * hand.palm_reach[0]
    motion_out[PALM_BODY] = min(motion_out[PALM_BODY], math.sqrt(square) + 0.5 * bend)
    for f in range(FINGER_COUNT):
        joints, axis, spread = pose.joints[f], pose.axis[f], pose.abduction_axis[f]
        x, y, z = joints[0, 0] - pose.position[0], joints[0, 1] - pose.position[1], joints[0, 2] - pose.position[2]
        vx, vy, vz = px + wy * z - wz * y, py + wz * x - wx * z, pz + wx * y - wy * x
        a = abduction_step[f]
        ux, uy, uz = wx + a * spread[0], wy + a * spread[1], wz + a * spread[2]
        before = vx * vx + vy * vy + vz * vz
        for k in range(PHALANX_COUNT):
            angle = step[6 + 3 * f + k]
            ux, uy, uz = ux + angle * axis[0], uy + angle * axis[1], uz + angle * axis[2]
            x, y, z = joints[k + 1, 0] - joints[k, 0], joints[k + 1, 1] - joints[k, 1], joints[k + 1, 2] - joints[k, 2]
            vx, vy, vz = vx + uy * z - uz * y, vy + uz * x - ux * z, vz + ux * y - uy * x
            after = vx * vx + vy * vy + vz * vz
            size, bend = turn, turn * turn * hand.reach[f, k]
            for i in range(-1, k + 1):
                angle = abs(a) if i < 0 else abs(step[6 + 3 * f + i])
                bend += angle * hand.lever[f, k, max(i, 0)] * (angle + 2.0 * size)
                size += angle
            motion = math.sqrt(max(before, after)) + 0.5 * bend
            motion_out[3 * f + k] = min(motion_out[3 * f + k], motion)
            before = after


@jit_allocating
def place_hands(
    hand: HandArrays, position: Array, rotation: Array, flexion: Array, abduction: Array, joints_out: Array
) -> None:
    """Compute the joint and tip positions [m], shape (T, 5, 4, 3), of T configurations as of `forward_kinematics`."""
    direction = np.empty((FINGER_COUNT, PHALANX_COUNT, 3))
    axis, spread = np.empty((FINGER_COUNT, 3)), np.empty((FINGER_COUNT, 3))
    for t in range(position.shape[0]):
        joints = joints_out[t]
        forward_kinematics(hand, position[t], rotation[t], flexion[t], abduction[t], joints, direction, axis, spread)
