"""The quadratic program of one linearisation, from contact records and joint limits.

Around the graphic configuration q_g the step δ = (δp, δφ, δθ) [m, rad, rad] minimises the coupling energy of the paper's Eq. 2,

    ½ (δ - δ*)ᵀ G (δ - δ*),   δ* = q_h - q_g   (δφ* the rotation vector from graphic to haptic palm),

subject to d_i + ∇d_i · δ >= ε for every contact and to the joint limits. The distances are true signed distances, not the squared
ones of Eq. 10: they are convex in a translation of the hand, so that a step which satisfies the linearised row cannot penetrate
by translation; what is left is second order in the rotation.

With P the contact point, n the normal, p the palm's origin, J_k and a the centre and axis of a joint,
∇d = (n, (P - p) × n, n · (a × (P - J_k))). Columns are divided by √G, which makes the Hessian the identity, so that multipliers
come out in N for contacts and N·m for joint limits.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .contact import Contacts
from .hand import DOF, FINGER_COUNT, PHALANX_COUNT, HandArrays
from .jit import jit
from .pose import HandPose

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LIMIT_ROWS = 2 * FINGER_COUNT * PHALANX_COUNT
CUT_ROWS = 64
"""Rows kept free behind the contacts: joint limits, and the cuts of the progressive method."""
EXTRA_ROWS = LIMIT_ROWS + CUT_ROWS


class Problem(NamedTuple):
    """Rows in the layout of `kernels.active_set`; contact i is row i, then 30 joint limits, then the cuts.

    | field | meaning | shape |
    |---|---|---|
    | common | palm columns, divided by √G | (6, capacity) |
    | block | columns of the row's own finger, divided by √G | (3, capacity) |
    | rhs | [m] for contacts, [rad] for limits | (capacity,) |
    | target | √G δ*: the step to the haptic hand | (21,) |
    | abduction_step | step of the abduction, not optimised [rad] | (5,) |
    | inverse_root | 1 / √G of each variable | (21,) |
    """

    common: Array
    block: Array
    rhs: Array
    target: Array
    abduction_step: Array
    inverse_root: Array


@jit
def contact_row(
    pose: HandPose, contacts: Contacts, i: int, inverse_root: Array, finger: int, row: int, common: Array, block: Array
) -> None:
    """Gradient of the distance of contact i, scaled; `finger` is -1 for the palm."""
    nx, ny, nz = contacts.normal[0, i], contacts.normal[1, i], contacts.normal[2, i]
    x, y, z = contacts.point[0, i], contacts.point[1, i], contacts.point[2, i]
    rx, ry, rz = x - pose.position[0], y - pose.position[1], z - pose.position[2]
    common[0, row] = nx * inverse_root[0]
    common[1, row] = ny * inverse_root[1]
    common[2, row] = nz * inverse_root[2]
    common[3, row] = (ry * nz - rz * ny) * inverse_root[3]
    common[4, row] = (rz * nx - rx * nz) * inverse_root[4]
    common[5, row] = (rx * ny - ry * nx) * inverse_root[5]
    if finger < 0:
        block[0, row] = 0.0
        block[1, row] = 0.0
        block[2, row] = 0.0
        return
    ax, ay, az = pose.axis[finger, 0], pose.axis[finger, 1], pose.axis[finger, 2]
    # n · (a × r) = r · (n × a), and n × a is the same for the finger's three parallel axes.
    cx, cy, cz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    phalanx = contacts.body[i] - PHALANX_COUNT * finger
    for k in range(PHALANX_COUNT):
        if k > phalanx:
            block[k, row] = 0.0
        else:
            jx, jy, jz = pose.joints[finger, k, 0], pose.joints[finger, k, 1], pose.joints[finger, k, 2]
            lever = (x - jx) * cx + (y - jy) * cy + (z - jz) * cz
            block[k, row] = lever * inverse_root[6 + 3 * finger + k]


@jit
def build_rows(
    hand: HandArrays, pose: HandPose, contacts: Contacts, offset: float, relaxed: bool, problem: Problem
) -> None:
    """Fill rows and right-hand sides for the contacts and joint limits at `pose`; target and abduction step are set before.

    Args:
        hand: the hand.
        pose: the configuration about which to linearise.
        contacts: records at that configuration.
        offset: ε, the clearance [m] that active contacts are to keep.
        relaxed: ask nothing of contacts nearer than ε but not to come nearer, so that standing still is allowed
            wherever nothing penetrates.
        problem: the rows, written.
    """
    weight = problem.inverse_root
    for group in range(FINGER_COUNT + 1):
        finger = group - 1
        for i in range(contacts.start[group], contacts.start[group + 1]):
            contact_row(pose, contacts, i, weight, finger, i, problem.common, problem.block)
            rhs = offset - contacts.distance[i]
            if relaxed and rhs > 0.0 and contacts.distance[i] >= 0.0:
                rhs = 0.0
            if finger >= 0 and problem.abduction_step[finger] != 0.0:
                # The glove moves the abduction: what it takes from the distance the optimised joints must give.
                bx, by, bz = (
                    pose.abduction_axis[finger, 0],
                    pose.abduction_axis[finger, 1],
                    pose.abduction_axis[finger, 2],
                )
                rx = contacts.point[0, i] - pose.joints[finger, 0, 0]
                ry = contacts.point[1, i] - pose.joints[finger, 0, 1]
                rz = contacts.point[2, i] - pose.joints[finger, 0, 2]
                rate = (
                    contacts.normal[0, i] * (by * rz - bz * ry)
                    + contacts.normal[1, i] * (bz * rx - bx * rz)
                    + contacts.normal[2, i] * (bx * ry - by * rx)
                )
                rhs -= rate * problem.abduction_step[finger]
            problem.rhs[i] = rhs
    row = contacts.start[FINGER_COUNT + 1]
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            for side in range(2):
                for j in range(6):
                    problem.common[j, row] = 0.0
                for j in range(PHALANX_COUNT):
                    problem.block[j, row] = 0.0
                scale = weight[6 + 3 * f + k]
                # A joint beyond its limit may stay there but go no further, so that standing still is allowed.
                if side == 0:
                    problem.block[k, row] = scale
                    problem.rhs[row] = min(hand.flexion_min[f, k] - pose.flexion[f, k], 0.0)
                else:
                    problem.block[k, row] = -scale
                    problem.rhs[row] = min(pose.flexion[f, k] - hand.flexion_max[f, k], 0.0)
                row += 1


@jit
def limit_start(contacts: Contacts, finger: int) -> int:
    """First joint-limit row of a finger; `finger` 5 gives the row after the last."""
    return contacts.start[FINGER_COUNT + 1] + 2 * PHALANX_COUNT * finger


@jit
def clamp_to_limits(hand: HandArrays, pose: HandPose, step: Array) -> None:
    """Shorten the flexion of a step, shape (21,), so that it stays within the joint limits: the optimum without contacts."""
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            j = DOF - 3 * (FINGER_COUNT - f) + k
            low = min(hand.flexion_min[f, k] - pose.flexion[f, k], 0.0)
            high = max(hand.flexion_max[f, k] - pose.flexion[f, k], 0.0)
            step[j] = min(max(step[j], low), high)
