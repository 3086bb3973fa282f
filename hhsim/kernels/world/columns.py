"""Columns of a program of hands and bodies: which variables move a contact's point, and how.

A *pair* is one hand and one body, or one body that another one meets: the pair's contacts are in the frame of its
body, where a hand, or the other body, is what moves. The first pairs are those of each hand and the first body. A
hand's variables are in the frame of the first body, a body's in its own: translation of its centre, and rotation
about its principal axes. Their columns come in the order palm, first body, second palm, further bodies, which all rows
have; then three of each finger, which only rows of that finger have. A fixed body has none: what is written for it
goes to columns behind all others, which no program reads.

With Δ the displacement of a contact point of the hand relative to the body's in this step, and φ the relative
rotation, a row is that of m · Δ + w · φ.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.contact.linearise import LIMIT_ROWS
from hhsim.kernels.hand.kinematics import BODY_COUNT, FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Array, Record, Triple, as_bool, as_int64, jit, jit_inline
from hhsim.kernels.qp.row_scan import Rows
from hhsim.kernels.rotation import turned, turned_back
from hhsim.kernels.world.body import SLIDER

States: TypeAlias = NDArray[np.void]
"""State of each pair. The first one also has what the whole tick shares: all contacts, flags, progress and work."""

ROW_KINDS = 8
"""Keys of rows: that of their contact times this, plus 0 for its normal row, or 1 and on for those of friction."""


@jit_inline
def common_count(problem: Record) -> int:
    """Return the number of columns that all rows have: of palms and bodies, then of slack variables."""
    return problem.width + problem.slacks


@jit_inline
def variable_count(problem: Record) -> int:
    """Return the number of the program's variables."""
    return first_finger(problem, problem.hands)


@jit_inline
def body_of(problem: Record, contact_code: int) -> int:
    """Return the body of a contact: code BODY_COUNT p + b is body b of pair p, -1 - k is body k on its table."""
    return -1 - contact_code if contact_code < 0 else problem.body[contact_code // BODY_COUNT]


@jit_inline
def other_of(problem: Record, contact_code: int) -> int:
    """Return the body that meets the contact's body there; -1 where it is a hand or the table."""
    return as_int64(-1) if contact_code < 0 else problem.other[contact_code // BODY_COUNT]


@jit_inline
def is_still(problem: Record) -> bool:
    """Return True where no body has variables."""
    return as_bool(problem.width == 6 * problem.hands)


@jit_inline
def first_finger(problem: Record, hand: int) -> int:
    """Return the first variable of the fingers of a hand."""
    return common_count(problem) + PHALANX_COUNT * FINGER_COUNT * hand


@jit_inline
def hand_column(problem: Record, hand: int, j: int) -> int:
    """Return the program's variable that is variable j of a hand, 0 to 20: of its palm, then of its fingers."""
    return problem.palm[hand] + j if j < 6 else first_finger(problem, hand) + j - 6


@jit
def own_columns(problem: Record, contact_code: int) -> int:
    """Return the first variable of the finger of a hand body; -1 for a palm, a body and the table."""
    if contact_code < 0:
        return -1
    pair = contact_code // BODY_COUNT
    body = contact_code - BODY_COUNT * pair
    if body >= PALM_BODY:
        return -1
    return first_finger(problem, problem.hand[pair]) + PHALANX_COUNT * (body // PHALANX_COUNT)


@jit
def coefficient(world: Record, contact_code: int) -> float:
    """μ of a contact."""
    body, other = world.bodies[body_of(world.problem, contact_code)], other_of(world.problem, contact_code)
    if other >= 0:
        return math.sqrt(body.table_friction * world.bodies[other].table_friction)
    return body.table_friction if contact_code < 0 else body.friction


@jit
def torsion_radius(world: Record, contact_code: int) -> float:
    """γ of a contact [m]: what a hand's bears, and no other."""
    is_hand = contact_code >= 0 and other_of(world.problem, contact_code) < 0
    return world.bodies[body_of(world.problem, contact_code)].torsion if is_hand else 0.0


@jit
def _object_columns(start: int, stop: int, contacts: Record, body: Record, column: int, common: Array) -> None:
    point, normal, axes, inverse_root = contacts.point, contacts.normal, body.axes, body.inverse_root
    cx, cy, cz = body.center[0], body.center[1], body.center[2]
    translation = -inverse_root[0]
    a, b, c = -inverse_root[3], -inverse_root[4], -inverse_root[5]
    a0, a1, a2 = a * axes[0, 0], a * axes[0, 1], a * axes[0, 2]
    b0, b1, b2 = b * axes[1, 0], b * axes[1, 1], b * axes[1, 2]
    c0, c1, c2 = c * axes[2, 0], c * axes[2, 1], c * axes[2, 2]
    for i in range(start, stop):
        nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
        rx, ry, rz = point[0, i] - cx, point[1, i] - cy, point[2, i] - cz
        mx, my, mz = ry * nz - rz * ny, rz * nx - rx * nz, rx * ny - ry * nx
        common[column, i] = nx * translation
        common[column + 1, i] = ny * translation
        common[column + 2, i] = nz * translation
        common[column + 3, i] = a0 * mx + a1 * my + a2 * mz
        common[column + 4, i] = b0 * mx + b1 * my + b2 * mz
        common[column + 5, i] = c0 * mx + c1 * my + c2 * mz


@jit_inline
def _fold(body: Record, column: int, row: int, common: Array) -> None:
    # A slider has one column: that of its translation along the axis.
    if body.joint == SLIDER:
        axis = body.axes[2]
        x, y, z = common[column, row], common[column + 1, row], common[column + 2, row]
        common[column, row] = axis[0] * x + axis[1] * y + axis[2] * z
        common[column + 1, row] = common[column + 2, row] = 0.0


@jit
def _other_columns(
    body: Record, pose: Record, column: int, row: int, p: Array, m: Triple, w: Triple, common: Array
) -> None:
    # Columns of the body that meets the contact's one, in whose frame its centre is at `pose`.
    r, root = pose.rotation, body.inverse_root
    rx, ry, rz = turned_back(r, p[0] - pose.position[0], p[1] - pose.position[1], p[2] - pose.position[2])
    mx, my, mz = turned_back(r, m[0], m[1], m[2])
    x, y, z = turned(body.axes, ry * mz - rz * my, rz * mx - rx * mz, rx * my - ry * mx)
    common[column, row], common[column + 1, row], common[column + 2, row] = mx * root[0], my * root[1], mz * root[2]
    common[column + 3, row], common[column + 4, row], common[column + 5, row] = x * root[3], y * root[4], z * root[5]
    if w[0] != 0.0 or w[1] != 0.0 or w[2] != 0.0:
        x, y, z = turned_back(r, w[0], w[1], w[2])
        turn = turned(body.axes, x, y, z)
        for j in range(3):
            common[column + 3 + j, row] += turn[j] * root[3 + j]
    _fold(body, column, row, common)


@jit_inline
def _turn_palm(turn: Array, row: int, palm: int, common: Array) -> None:
    # A palm's columns, from the frame of a pair's body to that of the first one.
    for first in (palm, palm + 3):
        x, y, z = turned_back(turn, common[first, row], common[first + 1, row], common[first + 2, row])
        common[first, row], common[first + 1, row], common[first + 2, row] = x, y, z


@jit_inline
def wide_rows(problem: Record) -> Rows:
    """Return the rows of a program of hands and bodies."""
    return Rows(
        common_count(problem),
        problem.common[:],
        problem.block[:],
        problem.rhs[:],
        problem.group_start[: problem.groups],
        problem.group_stop[: problem.groups],
        problem.group_block[: problem.groups],
        problem.dense[:],
        problem.dense_row,
        problem.dense_rows,
        variable_count(problem) - common_count(problem),
    )


@jit_inline
def name_row(problem: Record, row: int, key: int, owner: int, kind: int) -> int:
    """Name a row by its key, its place among the contacts with friction or -1, and its kind; return the one behind."""
    problem.key[row], problem.owner[row], problem.kind[row] = key, owner, kind
    return row + 1


@jit
def name_rows(contacts: Record, problem: Record) -> None:
    """Name the normal rows of all contacts and the joint limits by keys, and clear their columns but the palm's.

    `contacts` are those of the first pair, and behind its joint limits those of the others.
    """
    for p in range(problem.pairs):
        first, last, alone = problem.first[p], problem.last[p], problem.other[p] < 0
        palm, limits = problem.palm[problem.hand[p]], last + (LIMIT_ROWS if p < problem.hands else 0)
        for j in range(common_count(problem)):
            if not (alone and palm <= j < palm + 6):
                for i in range(first, limits):
                    problem.common[j, i] = 0.0
        for i in range(first, last):
            problem.key[i] = ROW_KINDS * contacts.key[i]
        for i in range(last, limits):
            problem.key[i] = last - i - 1 - LIMIT_ROWS * p
        for i in range(first, limits):
            problem.owner[i] = -1
            problem.kind[i] = 0


@jit
def object_columns(states: States, world: Record) -> None:
    """Write the bodies' columns of the rows that `name_rows` has named."""
    bodies, problem, common, contacts = world.bodies, world.problem, world.problem.common, states[0].contacts
    for p in range(problem.pairs):
        first, last, number = problem.first[p], problem.last[p], problem.body[p]
        column, palm = problem.column[number], problem.palm[problem.hand[p]]
        body, other = bodies[number], problem.other[p]
        if other >= 0:
            palm = problem.column[other]
        _object_columns(first, last, contacts, body, column, common)
        for i in range(first, last):
            _fold(body, column, i, common)
            if other >= 0:
                n = contacts.normal[0, i], contacts.normal[1, i], contacts.normal[2, i]
                point = problem.scratch
                point[0], point[1], point[2] = contacts.point[0, i], contacts.point[1, i], contacts.point[2, i]
                _other_columns(bodies[other], states[p].pose, palm, i, point[:], n, (0.0, 0.0, 0.0), common)
            elif number > 0:
                _turn_palm(problem.turn[p], i, palm, common)


@jit
def relative_motion(
    states: States, world: Record, abduction_step: Array, step: Array, contact_code: int, point: Array
) -> tuple[float, float, float, float, float, float]:
    """Compute displacement [m] and rotation [rad] of what meets a body, at a point of it; of the table, the body's own.

    They are relative to the contact's body, in its frame; the step is unscaled, in the program's order.
    """
    bodies, problem = world.bodies, world.problem
    number = body_of(problem, contact_code)
    body, c = bodies[number], problem.column[number]
    px, py, pz = point[0], point[1], point[2]
    wx, wy, wz = turned_back(body.axes, step[c + 3], step[c + 4], step[c + 5])
    rx, ry, rz = px - body.center[0], py - body.center[1], pz - body.center[2]
    x = step[c] + wy * rz - wz * ry
    y = step[c + 1] + wz * rx - wx * rz
    z = step[c + 2] + wx * ry - wy * rx
    if contact_code < 0:
        return x, y, z, wx, wy, wz
    pair, other = contact_code // BODY_COUNT, other_of(problem, contact_code)
    pose = states[pair].pose
    rx, ry, rz = px - pose.position[0], py - pose.position[1], pz - pose.position[2]
    if other >= 0:
        body, c = bodies[other], problem.column[other]
        ux, uy, uz = turned_back(body.axes, step[c + 3], step[c + 4], step[c + 5])
        rx, ry, rz = turned_back(pose.rotation, rx, ry, rz)
        vx, vy, vz = step[c] + uy * rz - uz * ry, step[c + 1] + uz * rx - ux * rz, step[c + 2] + ux * ry - uy * rx
        vx, vy, vz = turned(pose.rotation, vx, vy, vz)
        ux, uy, uz = turned(pose.rotation, ux, uy, uz)
        return vx - x, vy - y, vz - z, ux - wx, uy - wy, uz - wz
    hand = problem.hand[pair]
    palm, fingers = problem.palm[hand], first_finger(problem, hand)
    vx, vy, vz, ux, uy, uz = step[palm], step[palm + 1], step[palm + 2], step[palm + 3], step[palm + 4], step[palm + 5]
    if number > 0:
        vx, vy, vz = turned(problem.turn[pair], vx, vy, vz)
        ux, uy, uz = turned(problem.turn[pair], ux, uy, uz)
    x = vx + uy * rz - uz * ry - x
    y = vy + uz * rx - ux * rz - y
    z = vz + ux * ry - uy * rx - z
    wx, wy, wz = ux - wx, uy - wy, uz - wz
    hand_body = contact_code - BODY_COUNT * pair
    if hand_body == PALM_BODY:
        return x, y, z, wx, wy, wz
    f, total = hand_body // PHALANX_COUNT, 0.0
    ax, ay, az = pose.axis[f, 0], pose.axis[f, 1], pose.axis[f, 2]
    for k in range(hand_body % PHALANX_COUNT + 1):
        turn = step[fingers + PHALANX_COUNT * f + k]
        rx, ry, rz = px - pose.joints[f, k, 0], py - pose.joints[f, k, 1], pz - pose.joints[f, k, 2]
        x += turn * (ay * rz - az * ry)
        y += turn * (az * rx - ax * rz)
        z += turn * (ax * ry - ay * rx)
        total += turn
    turn, spread = abduction_step[FINGER_COUNT * hand + f], pose.abduction_axis[f]
    wx += total * ax + turn * spread[0]
    wy += total * ay + turn * spread[1]
    wz += total * az + turn * spread[2]
    if turn != 0.0:
        ax, ay, az = spread[0], spread[1], spread[2]
        rx, ry, rz = px - pose.joints[f, 0, 0], py - pose.joints[f, 0, 1], pz - pose.joints[f, 0, 2]
        x += turn * (ay * rz - az * ry)
        y += turn * (az * rx - ax * rz)
        z += turn * (ax * ry - ay * rx)
    return x, y, z, wx, wy, wz


@jit
def write_row(
    states: States, world: Record, contact_code: int, row: int, point: Array, m: Triple, w: Triple, rhs: float
) -> None:
    """Write a row for the displacement along m plus the rotation along w."""
    bodies, problem = world.bodies, world.problem
    number, other = body_of(problem, contact_code), other_of(problem, contact_code)
    body, column = bodies[number], problem.column[number]
    common, block, weight, root = problem.common, problem.block, problem.inverse_root, body.inverse_root
    px, py, pz = point[0], point[1], point[2]
    mx, my, mz = m
    wx, wy, wz = w
    sign = 1.0 if contact_code < 0 else -1.0
    pair = max(contact_code, 0) // BODY_COUNT
    hand, hand_body = problem.hand[pair], contact_code - BODY_COUNT * pair
    pose = states[pair].pose
    width = common_count(problem)
    for j in range(width):
        common[j, row] = 0.0
    if other >= 0:
        _other_columns(bodies[other], pose, problem.column[other], row, point, m, w, common)
    elif contact_code >= 0:
        palm = problem.palm[hand]
        rx, ry, rz = px - pose.position[0], py - pose.position[1], pz - pose.position[2]
        translation, rotation = weight[0], weight[3]
        common[palm, row] = mx * translation
        common[palm + 1, row] = my * translation
        common[palm + 2, row] = mz * translation
        common[palm + 3, row] = (ry * mz - rz * my + wx) * rotation
        common[palm + 4, row] = (rz * mx - rx * mz + wy) * rotation
        common[palm + 5, row] = (rx * my - ry * mx + wz) * rotation
        if number > 0:
            _turn_palm(problem.turn[pair], row, palm, common)
    rx, ry, rz = px - body.center[0], py - body.center[1], pz - body.center[2]
    common[column, row] = sign * mx * root[0]
    common[column + 1, row] = sign * my * root[1]
    common[column + 2, row] = sign * mz * root[2]
    x, y, z = turned(body.axes, ry * mz - rz * my + wx, rz * mx - rx * mz + wy, rx * my - ry * mx + wz)
    _fold(body, column, row, common)
    common[column + 3, row] = sign * x * root[3]
    common[column + 4, row] = sign * y * root[4]
    common[column + 5, row] = sign * z * root[5]
    for k in range(PHALANX_COUNT):
        block[k, row] = 0.0
    if contact_code >= 0 and hand_body < PALM_BODY:
        f = hand_body // PHALANX_COUNT
        ax, ay, az = pose.axis[f, 0], pose.axis[f, 1], pose.axis[f, 2]
        for k in range(hand_body % PHALANX_COUNT + 1):
            rx, ry, rz = px - pose.joints[f, k, 0], py - pose.joints[f, k, 1], pz - pose.joints[f, k, 2]
            lever = ax * (ry * mz - rz * my + wx) + ay * (rz * mx - rx * mz + wy) + az * (rx * my - ry * mx + wz)
            block[k, row] = lever * weight[6 + PHALANX_COUNT * f + k]
        turn = states[hand].problem.abduction_step[f]
        if turn != 0.0:
            ax, ay, az = pose.abduction_axis[f, 0], pose.abduction_axis[f, 1], pose.abduction_axis[f, 2]
            rx, ry, rz = px - pose.joints[f, 0, 0], py - pose.joints[f, 0, 1], pz - pose.joints[f, 0, 2]
            rate = ax * (ry * mz - rz * my + wx) + ay * (rz * mx - rx * mz + wy) + az * (rx * my - ry * mx + wz)
            rhs -= rate * turn
    problem.rhs[row] = rhs
