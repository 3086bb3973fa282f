"""Rows of a quadratic program from contacts and joint limits, and which of them follow from others.

Around the graphic configuration q_g the step δ = (δp, δφ, δθ) [m, rad, rad] minimises the coupling energy of the
paper's Eq. 2,

    ½ (δ - δ*)ᵀ G (δ - δ*),   δ* = q_h - q_g   (δφ* the rotation vector from graphic to haptic palm),

subject to d_i + ∇d_i · δ >= ε for every contact and to the joint limits. The distances are true signed distances, not
the squared ones of Eq. 10: they are convex in a translation of the hand, so that a step which satisfies the linearised
row cannot penetrate by translation; the remainder is second order in the rotation.

With P the contact point, n the normal, p the palm's origin, J_k and a the centre and axis of a joint,
∇d = (n, (P - p) × n, n · (a × (P - J_k))). Columns are divided by √G, which makes the Hessian the identity, so that
multipliers come out in N for contacts and N·m for joint limits.

A patch of a sphere tree brings many contacts with nearly the same normal, one above the other. Let contact j be on the
same rigid body as contact i, x the points of the body's axis (or of the palm's sphere) that are nearest to the two
spheres, n their normals, d their distances. A step turns the body by a rotation vector w, and moves x_j by v_j, so that
v_i = v_j + w × (x_i - x_j). If the program holds row j, d_j + n_j · v_j >= ε, then

    d_i + n_i · v_i = d_i + n_j · v_j + n_i · (w × (x_i - x_j)) + (n_i - n_j) · v_j
                   >= ε + (d_i - d_j) - |w| |x_i - x_j| - |n_i - n_j| |v_j|,

and no step is longer than `reach` at any axis point of a body that has contacts: |v_j| <= reach, and |w| <= reach over
the body's turning lever, of a phalanx across its axis, along which x_i - x_j lies. Hence row i follows from row j where

    d_i - d_j >= reach · (|x_i - x_j| / lever + |n_i - n_j|).

The first reference is the body's nearest contact, which a step is most likely to meet; then the nearest of those that
do not follow from it, and so on.
"""

import numpy as np

from hhsim.kernels.arithmetic import fused, least_above, product
from hhsim.kernels.contact.detection import CONTACT_ROWS
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT, HandArrays
from hhsim.kernels.jit import Array, Record, Triple, jit, jit_inline

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


@jit
def point_jacobian(
    pose: Record, body: int, point: Triple, normal: Triple, floor: float, gradient_out: Array, spread_out: Array
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
def finger_columns(pose: Record, f: int, contacts: Record, inverse_root: Array, floor: float, block: Array) -> None:
    """Compute the columns of a finger's contacts, scaled by (3,) of its joints; levers up to `floor` [m] are zero."""
    start, stop, point, normal = contacts.start[f + 1], contacts.start[f + 2], contacts.point, contacts.normal
    ax, ay, az = pose.axis[f, 0], pose.axis[f, 1], pose.axis[f, 2]
    for k in range(PHALANX_COUNT):
        jx, jy, jz = pose.joints[f, k, 0], pose.joints[f, k, 1], pose.joints[f, k, 2]
        scale = inverse_root[k]
        # A joint does not move the phalanges before it.
        first = start if k == 0 else contacts.phalanx_end[f, k - 1]
        for i in range(start, first):
            block[k, i] = 0.0
        for i in range(first, stop):
            # n · (a × r) = r · (n × a)
            nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
            rx, ry, rz = point[0, i] - jx, point[1, i] - jy, point[2, i] - jz
            lever = rx * (ny * az - nz * ay) + ry * (nz * ax - nx * az) + rz * (nx * ay - ny * ax)
            block[k, i] = lever * scale if abs(lever) > floor else 0.0


@jit
def limit_rows(
    row: int, flexion: Array, lowest: Array, highest: Array, scale: Array, common: Array, block: Array, rhs: Array
) -> None:
    """Write a finger's rows of joint limits from `row` on, two a joint; lowest, highest, scale are of shape (3,)."""
    for j in range(6):
        zeros = common[j, row : row + 2 * PHALANX_COUNT]
        for i in range(2 * PHALANX_COUNT):
            zeros[i] = 0.0
    for j in range(PHALANX_COUNT):
        zeros = block[j, row : row + 2 * PHALANX_COUNT]
        for i in range(2 * PHALANX_COUNT):
            zeros[i] = 0.0
    for k in range(PHALANX_COUNT):
        block[k, row + 2 * k], block[k, row + 2 * k + 1] = scale[k], -scale[k]
        # A joint beyond its limit may stay there but go no further, so that the zero step is feasible.
        rhs[row + 2 * k] = min(lowest[k] - flexion[k], 0.0)
        rhs[row + 2 * k + 1] = min(flexion[k] - highest[k], 0.0)


@jit_inline
def build_rows(
    hand: HandArrays, pose: Record, contacts: Record, offset: float, relaxed: bool, abduction: Array, problem: Record
) -> None:
    """Fill rows and right-hand sides for the contacts and joint limits at `pose`; `abduction`'s step [rad] is given.

    `offset` is ε, the clearance [m] of active contacts. If `relaxed`, contacts nearer than ε only may not come nearer,
    so that the zero step is feasible wherever nothing penetrates.
    """
    start, total = contacts.start, contacts.start[FINGER_COUNT + 1]
    point, normal, distance = contacts.point, contacts.normal, contacts.distance
    common, block, rhs, weight = problem.common, problem.block, problem.rhs, problem.inverse_root
    px, py, pz, translation, rotation = pose.position[0], pose.position[1], pose.position[2], weight[0], weight[3]
    for i in range(total):
        nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
        rx, ry, rz = point[0, i] - px, point[1, i] - py, point[2, i] - pz
        common[0, i] = nx * translation
        common[1, i] = ny * translation
        common[2, i] = nz * translation
        common[3, i] = fused(ry, nz, -rz * ny) * rotation
        common[4, i] = fused(rz, nx, -rx * nz) * rotation
        common[5, i] = fused(rx, ny, -ry * nx) * rotation
        rhs[i] = offset - distance[i]
    for i in range(total if relaxed else 0):
        if rhs[i] > 0.0 and distance[i] >= 0.0:
            rhs[i] = 0.0
    for f in range(FINGER_COUNT):
        first, last = start[f + 1], start[f + 2]
        scale = weight[6 + 3 * f : 9 + 3 * f]
        if last > first:
            finger_columns(pose, f, contacts, scale, LEVER_FLOOR * hand.length[f, 0], block)
            # An abduction step adds to the distances.
            step, base, spread = abduction[f], pose.joints[f, 0], pose.abduction_axis[f]
            bx, by, bz = spread[0], spread[1], spread[2]
            for i in range(first, last if step != 0.0 else first):
                rx, ry, rz = point[0, i] - base[0], point[1, i] - base[1], point[2, i] - base[2]
                turn = by * rz - bz * ry, bz * rx - bx * rz, bx * ry - by * rx
                rhs[i] -= product(normal[0, i], normal[1, i], normal[2, i], *turn) * step
        row, low, high = total + 2 * PHALANX_COUNT * f, hand.flexion_min[f], hand.flexion_max[f]
        limit_rows(row, pose.flexion[f], low, high, scale, common, block, rhs)


@jit_inline
def limit_start(contacts: Record, finger: int) -> int:
    """Return the first joint-limit row of a finger; `finger` 5 gives the row after the last."""
    return contacts.start[FINGER_COUNT + 1] + 2 * PHALANX_COUNT * finger


@jit_inline
def clamp_to_limits(hand: HandArrays, pose: Record, finger: int, step: Array) -> bool:
    """Clamp one finger's flexion in a step, shape (21,), to its joint limits: its optimum without contacts.

    Return whether that changed the step.
    """
    changed = False
    for k in range(PHALANX_COUNT):
        j = 6 + PHALANX_COUNT * finger + k
        low = min(hand.flexion_min[finger, k] - pose.flexion[finger, k], 0.0)
        high = max(hand.flexion_max[finger, k] - pose.flexion[finger, k], 0.0)
        clamped = min(max(step[j], low), high)
        changed = changed or clamped != step[j]
        step[j] = clamped
    return changed


REFERENCES = 3
"""Number of reference contacts of a body: most that follow from any do so from the first ones."""
REFERENCE = -np.inf
"""Mark of a reference contact; infinity marks one that follows, and any other number, its distance [m], an open one."""
FEWEST = 8
"""Least number of contacts of a body to thin: fewer rows cost less than the search."""


@jit_inline
def _drop_implied(
    start: int, stop: int, reference: int, per_metre: float, reach: float, contacts: Record, open_distance: Array
) -> None:
    point, normal, distance, hand_radius = contacts.point, contacts.normal, contacts.distance, contacts.hand_radius
    r = hand_radius[reference]
    ax, ay, az = normal[0, reference], normal[1, reference], normal[2, reference]
    bx, by = fused(r, ax, point[0, reference]), fused(r, ay, point[1, reference])
    bz = fused(r, az, point[2, reference])
    d, lever, turn = distance[reference], per_metre * per_metre, reach * reach
    for i in range(np.uint64(start), np.uint64(stop)):
        nx, ny, nz = normal[0, i], normal[1, i], normal[2, i]
        ri = hand_radius[i]
        x, y, z = fused(ri, nx, point[0, i]) - bx, fused(ri, ny, point[1, i]) - by, fused(ri, nz, point[2, i]) - bz
        nx, ny, nz = nx - ax, ny - ay, nz - az
        # √p + √q <= gap, without the roots.
        p, q = lever * product(x, y, z, x, y, z), turn * product(nx, ny, nz, nx, ny, nz)
        gap = distance[i] - d
        rest = fused(gap, gap, -p - q)
        before = open_distance[i]
        implied = (gap >= 0.0) & (rest >= 0.0) & (4.0 * p * q <= rest * rest) & (before > REFERENCE)
        open_distance[i] = np.inf if implied else before


@jit_inline
def move_contact(contacts: Record, source: int, target: int) -> None:
    """Copy a contact to another row."""
    contacts.body[target] = contacts.body[source]
    contacts.key[target] = contacts.key[source]
    for j in range(3):
        contacts.point[j, target] = contacts.point[j, source]
        contacts.normal[j, target] = contacts.normal[j, source]
        contacts.straight[j, target] = contacts.straight[j, source]
    contacts.distance[target] = contacts.distance[source]
    contacts.hand_radius[target] = contacts.hand_radius[source]
    contacts.object_radius[target] = contacts.object_radius[source]
    contacts.slides[target] = contacts.slides[source]


@jit_inline
def _thin(start: int, stop: int, row: int, lever: float, reach: float, contacts: Record, open_distance: Array) -> int:
    """Move those of the contacts [start, stop) that do not follow to `row` and on; return the row after them."""
    thins = stop - start >= FEWEST
    if thins:
        for i in range(np.uint64(start), np.uint64(stop)):
            open_distance[i] = contacts.distance[i]
        for _ in range(REFERENCES):
            least = least_above(open_distance, start, stop, REFERENCE)
            if least == np.inf:
                break
            nearest = start
            while open_distance[nearest] != least:
                nearest += 1
            open_distance[nearest] = REFERENCE
            _drop_implied(start, stop, nearest, reach / lever, reach, contacts, open_distance)
    for i in range(start, stop):
        if not thins or open_distance[i] < np.inf:
            if row < i:
                move_contact(contacts, i, row)
            row += 1
    return row


@jit_inline
def drop_redundant_contacts(hand: HandArrays, reach: float, contacts: Record, open_distance: Array) -> None:
    """Keep, in order, the contacts that do not follow from others of their body in a step of up to `reach` [m]."""
    start = contacts.start[0]
    stop = contacts.start[1]
    row = _thin(start, stop, start, hand.turning_lever[PALM_BODY], reach, contacts, open_distance)
    contacts.start[1] = row
    for f in range(FINGER_COUNT):
        for k in range(PHALANX_COUNT):
            start = stop
            stop = contacts.phalanx_end[f, k]
            row = _thin(start, stop, row, hand.turning_lever[3 * f + k], reach, contacts, open_distance)
            contacts.phalanx_end[f, k] = row
        contacts.start[f + 2] = row
