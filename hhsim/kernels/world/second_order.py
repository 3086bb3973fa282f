"""Second-order correction of a program's solution, by how the distances of contacts bend as the hand moves.

A contact between a sphere of radius r around the hand's axis point x and an object that is locally a sphere of radius R
around c has the distance D = |x - c| - r - R. With ρ = |x - c|, n the normal and V = ∂x/∂q,

    ∂²D/∂q² = Vᵀ (I - n nᵀ) V / ρ + n · ∂²x/∂q².

At an edge, which is straight along e, I - n nᵀ - e eᵀ takes the place of I - n nᵀ; on a face ρ is infinite.
Where the nearest point slides along a phalanx (axis parameter 0 < s < 1), d = min over s of D, and its Hessian is the
Schur complement D_qq - D_qs D_sq / D_ss. Only products with a vector are needed.

The quadratic program sees flat contacts. On a curved one the hand would then approach its optimum by a constant factor
a linearisation, the slower the harder it presses: contact force times curvature works against the coupling's stiffness,
and where it exceeds that, steps go too far, to and fro. So a program, but for the first one of a hand that stood still
in the last tick, is followed by the step of sequential quadratic programming with the exact Hessian of the Lagrangian,
G - Σ λ_i ∇²d_i, on the active set that the program found (Nocedal & Wright 2006, ch. 18): within the null space of the
active rows,

    P (I - S) P z = P S x,   S = Σ λ_i √G⁻¹ ∇²d_i √G⁻¹,

solved by conjugate gradients; where the curvature wins (z would run down a ridge) the search stops at a bounded
stretch, as in Steihaug's method. The corrected step x + z keeps the active rows, and is shortened before it violates
another one. The tick judges it by true distances like any other step.

What bends are a hand's contacts beside bodies that stand still, and the pairs of its own parts: two fingers that cross
meet with a small radius. Contacts of bodies that move count as flat.
"""

import math
from typing import NamedTuple

from hhsim.kernels.contact.hand_pairs import PairsCode
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Array, Indices, Record, Triple, as_bool, as_int64, jit, jit_inline
from hhsim.kernels.machine_code import run_code
from hhsim.kernels.memory import copy_values
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.qp.qr_update import project
from hhsim.kernels.qp.row_scan import Rows, row_violations
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.world.columns import States, common_count, first_finger, is_still, variable_count, wide_rows


@jit_inline
def _add_joints(
    pose: Record,
    finger: int,
    joints: int,
    place: Triple,
    normal: Triple,
    bend: Triple,
    pull: Triple,
    moment: Triple,
    force: float,
    step: Array,
    product_out: Array,
) -> None:
    """Add to Σ λ ∇²d · step what one contact gives for the first `joints` flexions of a finger.

    `place` is the contact's axis point [m], `bend` n × w with w the palm's rotation in the step [rad], `force` λ [N].
    `pull` [1] and `moment` [m] are the product's part for a translation of that point, and what a rotation adds.
    """
    (x, y, z), (nx, ny, nz), (hx, hy, hz) = place, normal, bend
    (fx, fy, fz), (mx, my, mz) = pull, moment
    if joints == 0:
        return
    ax, ay, az = pose.axis[finger, 0], pose.axis[finger, 1], pose.axis[finger, 2]
    for k in range(joints):
        qx = x - pose.joints[finger, k, 0]
        qy = y - pose.joints[finger, k, 1]
        qz = z - pose.joints[finger, k, 2]
        bx, by, bz = ay * qz - az * qy, az * qx - ax * qz, ax * qy - ay * qx
        value = bx * fx + by * fy + bz * fz + mx * ax + my * ay + mz * az
        # n · (w × b) = b · (n × w)
        value += bx * hx + by * hy + bz * hz
        for other in range(joints):
            inner = max(k, other)
            qx = x - pose.joints[finger, inner, 0]
            qy = y - pose.joints[finger, inner, 1]
            qz = z - pose.joints[finger, inner, 2]
            bx, by, bz = ay * qz - az * qy, az * qx - ax * qz, ax * qy - ay * qx
            # n · (a × b) = a · (b × n)
            value += step[6 + 3 * finger + other] * (
                ax * (by * nz - bz * ny) + ay * (bz * nx - bx * nz) + az * (bx * ny - by * nx)
            )
        product_out[6 + 3 * finger + k] += force * value


@jit
def curvature_product(
    pose: Record, contacts: Record, first: int, rows: Indices, multiplier: Array, step: Array, product_out: Array
) -> None:
    """Add Σ λ_i ∇²d_i · step, [N] and [N·m], over those of `rows` that are contacts, with multipliers λ [N].

    `first` is the row of the first contact. Step (δp, δφ, δθ) [m, rad, rad] and product have shape (21,).
    """
    total = contacts.start[FINGER_COUNT + 1]
    wx, wy, wz = step[3], step[4], step[5]
    for i in range(rows.shape[0]):
        row = rows[i] - first
        if not 0 <= row < total:
            continue
        force = multiplier[i]
        body = contacts.body[row]
        nx, ny, nz = contacts.normal[0, row], contacts.normal[1, row], contacts.normal[2, row]
        r = contacts.hand_radius[row]
        rho = r + contacts.object_radius[row] + contacts.distance[row]
        x, y, z = contacts.point[0, row] + r * nx, contacts.point[1, row] + r * ny, contacts.point[2, row] + r * nz
        rx, ry, rz = x - pose.position[0], y - pose.position[1], z - pose.position[2]
        finger = body // PHALANX_COUNT if body < PALM_BODY else -1
        joints = body % PHALANX_COUNT + 1 if body < PALM_BODY else 0
        # Velocity of the axis point: of the fingers' joints, and in all.
        ax, ay, az = 0.0, 0.0, 0.0
        jx, jy, jz = 0.0, 0.0, 0.0
        flexion = 0.0
        if finger >= 0:
            ax, ay, az = pose.axis[finger, 0], pose.axis[finger, 1], pose.axis[finger, 2]
            for k in range(joints):
                angle = step[6 + 3 * finger + k]
                flexion += angle
                qx = x - pose.joints[finger, k, 0]
                qy = y - pose.joints[finger, k, 1]
                qz = z - pose.joints[finger, k, 2]
                jx += angle * (ay * qz - az * qy)
                jy += angle * (az * qx - ax * qz)
                jz += angle * (ax * qy - ay * qx)
        tx, ty, tz = wy * rz - wz * ry, wz * rx - wx * rz, wx * ry - wy * rx
        vx, vy, vz = step[0] + tx + jx, step[1] + ty + jy, step[2] + tz + jz
        along = vx * nx + vy * ny + vz * nz
        ex, ey, ez = contacts.straight[0, row], contacts.straight[1, row], contacts.straight[2, row]
        ve = vx * ex + vy * ey + vz * ez
        fx, fy, fz = (
            (vx - along * nx - ve * ex) / rho,
            (vy - along * ny - ve * ey) / rho,
            (vz - along * nz - ve * ez) / rho,
        )
        mx, my, mz = 0.0, 0.0, 0.0
        if contacts.slides[row] == 1:
            ux = pose.direction[finger, joints - 1, 0]
            uy = pose.direction[finger, joints - 1, 1]
            uz = pose.direction[finger, joints - 1, 2]
            un = ux * nx + uy * ny + uz * nz
            ue = ux * ex + uy * ey + uz * ez
            sx, sy, sz = ux - un * nx - ue * ex, uy - un * ny - ue * ey, uz - un * nz - ue * ez
            across = (sx * sx + sy * sy + sz * sz) / rho
            if across > 0.0:
                ox, oy, oz = wx + flexion * ax, wy + flexion * ay, wz + flexion * az
                cx, cy, cz = uy * nz - uz * ny, uz * nx - ux * nz, ux * ny - uy * nx
                slide = ((sx * vx + sy * vy + sz * vz) / rho + ox * cx + oy * cy + oz * cz) / across
                fx, fy, fz = fx - slide * sx / rho, fy - slide * sy / rho, fz - slide * sz / rho
                mx, my, mz = -slide * cx, -slide * cy, -slide * cz
        # (w × r) and r × (n × w), halved: the exponential map's second derivative, symmetric in the two increments.
        hx, hy, hz = ny * wz - nz * wy, nz * wx - nx * wz, nx * wy - ny * wx
        gx = 0.5 * (ty * nz - tz * ny + ry * hz - rz * hy) + jy * nz - jz * ny
        gy = 0.5 * (tz * nx - tx * nz + rz * hx - rx * hz) + jz * nx - jx * nz
        gz = 0.5 * (tx * ny - ty * nx + rx * hy - ry * hx) + jx * ny - jy * nx
        product_out[0] += force * fx
        product_out[1] += force * fy
        product_out[2] += force * fz
        product_out[3] += force * (ry * fz - rz * fy + gx + mx)
        product_out[4] += force * (rz * fx - rx * fz + gy + my)
        product_out[5] += force * (rx * fy - ry * fx + gz + mz)
        place, normal, bend = (x, y, z), (nx, ny, nz), (hx, hy, hz)
        _add_joints(pose, finger, joints, place, normal, bend, (fx, fy, fz), (mx, my, mz), force, step, product_out)


FLAT_PROGRAMS = 3
"""First programs of a tick, in which a hand's own pairs do not bend: most ticks need no more, and these derivatives
take half a tick."""
STRETCH = 20.0
"""Most that a direction is stretched by, where the Lagrangian curves by less than 1 / STRETCH of the coupling."""
REDUCTION = 1e-4
"""Reduction of the squared residual at which the correction ends: the next linearisation starts from there."""
ROUNDING_SHARE = 1.0
"""Share of the program's tolerance by which a row may be violated at the corrected step and still be called kept."""
SPANNED = 1e-10
"""Squared length of a column's part outside the active rows below which they hold it."""
LONGEST_CORRECTED = 4.0
"""Steps longer than this many longest corrections are not corrected beside bodies: they end elsewhere, and the hand
gets on less."""
FINGERS = PHALANX_COUNT * FINGER_COUNT


class Lagrangian(NamedTuple):
    """Curved part of a program: each hand's contacts and own pairs that carry a multiplier."""

    pairs: PairsCode
    states: States
    world: Record
    row: Indices  # rows with a multiplier
    force: Array  # theirs [N]
    inverse_root: Array  # 1 / √G of the variables of what bends, 0 for all others
    offset: int  # the program's variables are n of all, from here on
    n: int


@jit_inline
def _curvature(lagrangian: Lagrangian, step: Array, work: Record, product_out: Array) -> None:
    """Compute Σ λ ∇²d · step over the loaded rows of a program, for a step of all variables [m, rad]."""
    world, row, force = lagrangian.world, lagrangian.row, lagrangian.force
    problem, still = world.problem, is_still(world.problem)
    # Of one hand alone the program's variables are the hand's.
    alone = still and problem.hands == 1
    for j in range(variable_count(problem)):
        product_out[j] = 0.0
    for h in range(problem.hands):
        each, palm, fingers = lagrangian.states[h], problem.palm[h], first_finger(problem, h)
        hand, product = step, product_out
        if not alone:
            hand, product = work.hand[:], work.bent[:]
            product[:] = 0.0
            for j in range(6):
                hand[j] = step[palm + j] if still else 0.0
            copy_values(step[fingers : fingers + FINGERS], hand[6:])
        if world.curved and still:
            curvature_product(each.pose, each.contacts, problem.first[h], row, force, hand, product)
        if each.hand_contact.bends:
            pairs, first = lagrangian.pairs, problem.dense_row
            arguments = pairs.address, as_int64(h), first, row, force, problem.inverse_root[:], hand, product
            run_code(pairs.curvature, arguments)
        if not alone:
            for j in range(6 if still else 0):
                product_out[palm + j] = product[j]
            copy_values(product[6:], product_out[fingers : fingers + FINGERS])


@jit_inline
def _apply(lagrangian: Lagrangian, step: Array, k: int, basis: Array, work: Record, image_out: Array) -> None:
    """Compute P S x of the program's own variables, for a step of all [m, rad]."""
    n, root, offset = lagrangian.n, lagrangian.inverse_root, lagrangian.offset
    _curvature(lagrangian, step, work, work.product[:])
    for j in range(n):
        image_out[j] = work.product[offset + j] * root[offset + j]
    for i in range(k):
        c = 0.0
        for j in range(n):
            c += basis[i, j] * image_out[j]
        for j in range(n):
            image_out[j] -= c * basis[i, j]


@jit_inline
def _conjugate_gradients(lagrangian: Lagrangian, k: int, basis: Array, square: float, work: Record) -> None:
    """Solve P (I - S) P z = residual for the correction z, up to a bounded stretch where the curvature wins."""
    n, residual, search, image, correction = lagrangian.n, work.residual, work.search, work.image, work.correction
    goal, root, offset = REDUCTION * square, lagrangian.inverse_root, lagrangian.offset
    work.whole[:] = 0.0
    for _ in range(n - k):
        for j in range(n):
            work.whole[offset + j] = search[j] * root[offset + j]
        _apply(lagrangian, work.whole[:], k, basis, work, image[:])
        along = 0.0
        length = 0.0
        for j in range(n):
            image[j] = search[j] - image[j]
            along += search[j] * image[j]
            length += search[j] * search[j]
        bounded = along * STRETCH < length
        stretch = square * STRETCH / length if bounded else square / along
        for j in range(n):
            correction[j] += stretch * search[j]
        if bounded:
            break
        for j in range(n):
            residual[j] -= stretch * image[j]
        previous = square
        square = 0.0
        for j in range(n):
            square += residual[j] * residual[j]
        if square <= goal:
            break
        for j in range(n):
            search[j] = residual[j] + square / previous * search[j]


@jit_inline
def _free_share(k: int, rows: Rows, end: Array, rounding: float, qp: QpWork) -> float:
    """Compute the share of the way from x to `end` on which no other row is violated.

    Rows satisfied at x may fail at the end; the first to fail bounds the share. A row that says the same as an active
    one is violated by rounding at either end: that is no failure, and would cancel the correction.
    """
    groups = rows.group_start.shape[0]
    for g in range(groups):
        for i in range(rows.group_start[g], rows.group_stop[g]):
            qp.slack[i] = -qp.violation[i]
    row_violations(rows, end, qp.inverse_norm[:], qp.violation[:])
    for j in range(k):
        qp.violation[qp.active[j]] = 0.0
    fraction = 1.0
    for g in range(groups):
        for i in range(rows.group_start[g], rows.group_stop[g]):
            violated = qp.violation[i]
            if violated > rounding:
                slack = max(qp.slack[i], 0.0)
                fraction = min(fraction, (slack + rounding) / (slack + violated))
    return fraction


@jit
def correct_program(
    lagrangian: Lagrangian, basis_rows: int, step: Array, rows: Rows, options: TickOptions, work: Record, qp: QpWork
) -> None:
    """Move qp.x, the solution of a program, to second order; `step` is that of all variables as far as known [m, rad].

    The correction is at right angles to the first `basis_rows` rows of qp.basis: the active set, or more.
    """
    n, k, correction, end = lagrangian.n, qp.counts[0], work.correction, work.search
    tolerance, longest = options.tolerance, options.longest_correction
    if k == 0 or basis_rows >= n:
        return
    _apply(lagrangian, step, basis_rows, qp.basis, work, work.residual[:])
    square = 0.0
    for j in range(n):
        correction[j], work.search[j] = 0.0, work.residual[j]
        square += work.residual[j] * work.residual[j]
    if square <= tolerance * tolerance:
        return
    _conjugate_gradients(lagrangian, basis_rows, qp.basis, square, work)
    length = 0.0
    for j in range(n):
        length += correction[j] * correction[j]
    scale = min(1.0, longest / math.sqrt(length)) if length > 0.0 else 0.0
    for j in range(n):
        correction[j] *= scale
        end[j] = qp.x[j] + correction[j]
    fraction = _free_share(k, rows, end[:], ROUNDING_SHARE * tolerance, qp)
    for j in range(n):
        qp.x[j] += fraction * correction[j]


@jit
def _add_bodies_to_basis(n: int, problem: Record, qp: QpWork) -> int:
    """Add the bodies' columns to the basis of the active rows; return the number of its rows.

    What moves a body is what the program's multipliers put on it, by Newton's equation.
    """
    k = qp.counts[0]
    for j in range(common_count(problem)):
        is_palm = False
        for h in range(problem.hands):
            is_palm = is_palm or 0 <= j - problem.palm[h] < 6
        if is_palm or k >= n:
            continue
        qp.normal[:] = 0.0
        qp.normal[j] = 1.0
        square = project(n, k, qp)
        if square > SPANNED:
            scale = 1.0 / math.sqrt(square)
            for i in range(qp.direction.shape[0]):
                qp.basis[k, i] = scale * qp.direction[i]
            k += 1
    return as_int64(k)


@jit
def correct(options: TickOptions, states: States, world: Record, qp: QpWork) -> bool:
    """Move a program's solution to second order in what bends; return whether it is another."""
    problem, n, bends, still = world.problem, variable_count(world.problem), False, is_still(world.problem)
    pairs = world.hand_pairs
    for i in range(pairs.count):
        is_own = pairs.hand[i, 0] == pairs.hand[i, 1]
        bends = bends or (is_own and pairs.multiplier[i] > 0.0 and states[pairs.hand[i, 0]].hand_contact.bends)
    if not still:
        square = 0.0
        for j in range(n):
            square += qp.x[j] * qp.x[j]
        bends = bends and square <= (LONGEST_CORRECTED * options.longest_correction) ** 2
    if not (bends or (world.curved and still)):
        return as_bool(False)
    root = world.bending_root
    for j in range(n):
        root[j] = 0.0
    for h in range(problem.hands):
        palm, first = problem.palm[h], first_finger(problem, h)
        if still:
            copy_values(problem.inverse_root[:6], root[palm : palm + 6])
        copy_values(problem.inverse_root[6:DOF], root[first : first + FINGERS])
    loaded, first = world.loaded, as_int64(0)
    row, force = loaded.row[: loaded.count], loaded.multiplier[: loaded.count]
    lagrangian = Lagrangian(options.pairs, states, world, row, force, root, first, n)
    basis_rows = qp.counts[0] if still else _add_bodies_to_basis(n, problem, qp)
    correct_program(lagrangian, basis_rows, problem.delta[:], wide_rows(problem), options, world.correction, qp)
    return as_bool(True)
