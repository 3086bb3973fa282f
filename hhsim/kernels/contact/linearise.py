"""Quadratic program of one linearisation, from contact records and joint limits.

Around the graphic configuration q_g the step δ = (δp, δφ, δθ) [m, rad, rad] minimises the coupling energy of the
paper's Eq. 2,

    ½ (δ - δ*)ᵀ G (δ - δ*),   δ* = q_h - q_g   (δφ* the rotation vector from graphic to haptic palm),

subject to d_i + ∇d_i · δ >= ε for every contact and to the joint limits. The distances are true signed distances, not
the squared ones of Eq. 10: they are convex in a translation of the hand, so that a step which satisfies the linearised
row cannot penetrate by translation; the remainder is second order in the rotation.

With P the contact point, n the normal, p the palm's origin, J_k and a the centre and axis of a joint,
∇d = (n, (P - p) × n, n · (a × (P - J_k))). Columns are divided by √G, which makes the Hessian the identity, so that
multipliers come out in N for contacts and N·m for joint limits.
"""

import numpy as np

from hhsim.kernels.arithmetic import fused, product
from hhsim.kernels.contact.detection import CONTACT_ROWS
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Array, Indices, Record, jit, jit_inline

LIMIT_ROWS = 2 * FINGER_COUNT * PHALANX_COUNT
"""Number of rows after the contacts: a lower and an upper joint limit for each of 15 joints."""


LEVER_FLOOR = 2e-5
"""Share of the finger's first phalanx below which a joint's lever of a contact counts as zero: levers of contacts at
the joint itself are rounding, and normalising such a row would demand any angle."""
ROW_CAPACITY = CONTACT_ROWS + LIMIT_ROWS

PROBLEM = np.dtype(
    [
        ("common", np.float64, (6, ROW_CAPACITY)),  # palm columns, divided by √G
        ("block", np.float64, (3, ROW_CAPACITY)),  # columns of the row's own finger, divided by √G
        ("rhs", np.float64, (ROW_CAPACITY,)),  # [m] for contacts, [rad] for limits
        ("target", np.float64, (DOF,)),  # √G δ*: the step to the haptic hand
        ("abduction_step", np.float64, (FINGER_COUNT,)),  # not optimised [rad]
        ("inverse_root", np.float64, (DOF,)),  # 1 / √G of each variable
    ],
    align=True,
)
"""Rows in the layout of `kernels.qp.active_set`; contact i is row i, then 30 joint limits."""


@jit_inline
def contact_rows(
    start: int,
    stop: int,
    point: Array,
    normal: Array,
    distance: Array,
    position: Array,
    inverse_root: Array,
    offset: float,
    common: Array,
    rhs: Array,
) -> None:
    """Compute scaled palm columns of contacts start … stop - 1 and their right-hand sides offset - distance."""
    px, py, pz = position[0], position[1], position[2]
    translation, rotation = inverse_root[0], inverse_root[3]
    for i in range(start, stop):
        nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
        rx, ry, rz = point[0, i] - px, point[1, i] - py, point[2, i] - pz
        common[0, i] = nx * translation
        common[1, i] = ny * translation
        common[2, i] = nz * translation
        common[3, i] = fused(ry, nz, -rz * ny) * rotation
        common[4, i] = fused(rz, nx, -rx * nz) * rotation
        common[5, i] = fused(rx, ny, -ry * nx) * rotation
        rhs[i] = offset - distance[i]


@jit
def point_jacobian(
    pose: Record,
    body: int,
    point: tuple[float, float, float],
    normal: tuple[float, float, float],
    floor: float,
    gradient_out: Array,
    spread_out: Array,
) -> None:
    """Write how a point [m] of a phalanx moves along a normal with its finger's joints and abduction, (21,) and (5,).

    Levers of joints up to `floor` [m] count as zero, which is there before.
    """
    finger, last = body // PHALANX_COUNT, body % PHALANX_COUNT
    (x, y, z), (nx, ny, nz) = point, normal
    for k in range(last + 2):
        joint = pose.joints[finger, k % (last + 1)]
        axis = pose.axis[finger] if k <= last else pose.abduction_axis[finger]
        rx, ry, rz = x - joint[0], y - joint[1], z - joint[2]
        ax, ay, az = axis[0], axis[1], axis[2]
        lever = nx * (ay * rz - az * ry) + ny * (az * rx - ax * rz) + nz * (ax * ry - ay * rx)
        if k > last:
            spread_out[finger] = lever
        elif abs(lever) > floor:
            gradient_out[6 + PHALANX_COUNT * finger + k] = lever


@jit
def finger_columns(
    start: int,
    stop: int,
    phalanx_end: Indices,
    point: Array,
    normal: Array,
    joints: Array,
    axis: Array,
    inverse_root: Array,
    floor: float,
    block: Array,
) -> None:
    """Compute scaled columns of one finger's contacts start … stop - 1; levers up to `floor` [m] count as zero.

    `phalanx_end`, shape (3,), is the end of each phalanx's contacts: a joint does not move the phalanges before it.
    """
    ax, ay, az = axis[0], axis[1], axis[2]
    for k in range(PHALANX_COUNT):
        jx, jy, jz = joints[k, 0], joints[k, 1], joints[k, 2]
        scale = inverse_root[k]
        first = start if k == 0 else phalanx_end[k - 1]
        for i in range(start, first):
            block[k, i] = 0.0
        for i in range(first, stop):
            # n · (a × r) = r · (n × a)
            nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
            rx, ry, rz = point[0, i] - jx, point[1, i] - jy, point[2, i] - jz
            lever = rx * (ny * az - nz * ay) + ry * (nz * ax - nx * az) + rz * (nx * ay - ny * ax)
            block[k, i] = lever * scale if abs(lever) > floor else 0.0


@jit_inline
def follow_abduction(
    start: int, stop: int, point: Array, normal: Array, base: Array, axis: Array, step: float, rhs: Array
) -> None:
    """Subtract from the right-hand sides what an abduction step [rad] about an axis adds to the distances."""
    bx, by, bz = axis[0], axis[1], axis[2]
    for i in range(start, stop):
        rx, ry, rz = point[0, i] - base[0], point[1, i] - base[1], point[2, i] - base[2]
        nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
        rate = product(nx, ny, nz, by * rz - bz * ry, bz * rx - bx * rz, bx * ry - by * rx)
        rhs[i] -= rate * step


@jit
def _relax(start: int, stop: int, distance: Array, rhs: Array) -> None:
    for i in range(start, stop):
        if rhs[i] > 0.0 and distance[i] >= 0.0:
            rhs[i] = 0.0


@jit
def limit_rows(
    row: int, flexion: Array, lowest: Array, highest: Array, scale: Array, common: Array, block: Array, rhs: Array
) -> None:
    """Write a finger's rows of joint limits from `row` on, two a joint; lowest, highest, scale are of shape (3,)."""
    for k in range(PHALANX_COUNT):
        for side in range(2):
            for j in range(6):
                common[j, row] = 0.0
            for j in range(PHALANX_COUNT):
                block[j, row] = 0.0
            # A joint beyond its limit may stay there but go no further, so that the zero step is feasible.
            if side == 0:
                block[k, row] = scale[k]
                rhs[row] = min(lowest[k] - flexion[k], 0.0)
            else:
                block[k, row] = -scale[k]
                rhs[row] = min(flexion[k] - highest[k], 0.0)
            row += 1


@jit_inline
def build_rows(hand: HandArrays, pose: Record, contacts: Record, offset: float, relaxed: bool, problem: Record) -> None:
    """Fill rows and right-hand sides for the contacts and joint limits at `pose`; the target is set before.

    `offset` is ε, the clearance [m] of active contacts. If `relaxed`, contacts nearer than ε only may not come nearer,
    so that the zero step is feasible wherever nothing penetrates.
    """
    start, total = contacts.start, contacts.start[FINGER_COUNT + 1]
    point, normal, distance = contacts.point, contacts.normal, contacts.distance
    common, block, rhs, weight = problem.common, problem.block, problem.rhs, problem.inverse_root
    contact_rows(0, total, point, normal, distance, pose.position, weight, offset, common, rhs)
    if relaxed:
        _relax(0, total, distance, rhs)
    for f in range(FINGER_COUNT):
        first, last = start[f + 1], start[f + 2]
        scale = weight[6 + 3 * f : 9 + 3 * f]
        if last > first:
            ends = contacts.phalanx_end[f]
            floor = LEVER_FLOOR * hand.length[f, 0]
            finger_columns(first, last, ends, point, normal, pose.joints[f], pose.axis[f], scale, floor, block)
            step = problem.abduction_step[f]
            if step != 0.0:
                follow_abduction(first, last, point, normal, pose.joints[f, 0], pose.abduction_axis[f], step, rhs)
        row, low, high = total + 2 * PHALANX_COUNT * f, hand.flexion_min[f], hand.flexion_max[f]
        limit_rows(row, pose.flexion[f], low, high, scale, common, block, rhs)


@jit_inline
def limit_start(contacts: Record, finger: int) -> int:
    """Return the first joint-limit row of a finger; `finger` 5 gives the row after the last."""
    return contacts.start[FINGER_COUNT + 1] + 2 * PHALANX_COUNT * finger


@jit_inline
def clamp_to_limits(hand: HandArrays, pose: Record, finger: int, step: Array) -> None:
    """Clamp one finger's flexion in a step, shape (21,), to its joint limits: its optimum without contacts."""
    for k in range(PHALANX_COUNT):
        j = 6 + PHALANX_COUNT * finger + k
        low = min(hand.flexion_min[finger, k] - pose.flexion[finger, k], 0.0)
        high = max(hand.flexion_max[finger, k] - pose.flexion[finger, k], 0.0)
        step[j] = min(max(step[j], low), high)
