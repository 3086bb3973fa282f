"""Second-order correction of a program's solution.

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

from hhsim.kernels.contact.own_parts import OwnParts, add_own_bends
from hhsim.kernels.copy import copy_values
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.jit import Array, Indices, Record, as_bool, as_int64, jit, jit_inline
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.qp.qr_update import project
from hhsim.kernels.qp.row_scan import Rows, row_violations
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.world.columns import (
    States,
    common_count,
    first_finger,
    hand_count,
    is_still,
    palm_column,
    variable_count,
    wide_rows,
)
from hhsim.kernels.world.curvature import curvature_product

FLAT_PROGRAMS = 3
"""First programs of a tick, in which a hand's own pairs do not bend: most ticks need no more, and these derivatives
take half a tick."""
STRETCH = 20.0
"""Most that a direction is stretched by, where the Lagrangian curves by less than 1 / STRETCH of the coupling."""
REDUCTION = 1e-4
"""Reduction of the squared residual at which the correction ends: the next linearisation starts from there."""
ROUNDING = 1.0
"""Share of the program's tolerance by which a row may be violated at the corrected step and still be called kept."""
SPANNED = 1e-10
"""Squared length of a column's part outside the active rows below which they hold it."""
FAR = 4.0
"""Steps longer than this many longest corrections are not corrected beside bodies: they end elsewhere, and the hand
gets on less."""
FINGERS = PHALANX_COUNT * FINGER_COUNT


class Lagrangian(NamedTuple):
    """Curved part of a program: each hand's contacts and own pairs that carry a multiplier."""

    own: OwnParts
    states: States
    world: Record
    row: Indices  # rows with a multiplier
    force: Array  # theirs [N]
    inverse_root: Array  # 1 / √G of the variables of what bends, 0 for all others
    offset: int  # the program's variables are n of all, from here on
    n: int


@jit
def _curvature(lagrangian: Lagrangian, step: Array, work: Record, product_out: Array) -> None:
    """Compute Σ λ ∇²d · step over the loaded rows of a program, for a step of all variables [m, rad]."""
    world, row, force = lagrangian.world, lagrangian.row, lagrangian.force
    problem, hand, product, still = world.problem, work.hand, work.bent, is_still(world.problem)
    product_out[:] = 0.0
    for h in range(hand_count(problem)):
        each, palm, fingers = lagrangian.states[h], palm_column(problem, h), first_finger(problem, h)
        product[:] = 0.0
        for j in range(6):
            hand[j] = step[palm + j] if still else 0.0
        copy_values(step[fingers : fingers + FINGERS], hand[6:])
        if world.curved and still:
            curvature_product(each.pose, each.contacts, problem.first[h], row, force, hand[:], product[:])
        if each.self_contact.bends:
            given, root = (each.pose, each.self_contact, problem.own_row[h]), problem.inverse_root[:]
            add_own_bends(lagrangian.own, *given, row, force, root, hand[:], product[:])
        for j in range(6 if still else 0):
            product_out[palm + j] = product[j]
        copy_values(product[6:], product_out[fingers : fingers + FINGERS])


@jit_inline
def _project_out(n: int, k: int, basis: Array, vector: Array) -> None:
    for i in range(k):
        c = 0.0
        for j in range(n):
            c += basis[i, j] * vector[j]
        for j in range(n):
            vector[j] -= c * basis[i, j]


@jit
def _apply(lagrangian: Lagrangian, k: int, basis: Array, work: Record, vector: Array, image_out: Array) -> None:
    """Compute P S v for a v that is zero outside the program's own variables."""
    root, offset = lagrangian.inverse_root, lagrangian.offset
    work.whole[:] = 0.0
    for j in range(lagrangian.n):
        work.whole[offset + j] = vector[j] * root[offset + j]
    _curvature(lagrangian, work.whole[:], work, work.product[:])
    for j in range(lagrangian.n):
        image_out[j] = work.product[offset + j] * root[offset + j]
    _project_out(lagrangian.n, k, basis, image_out)


@jit
def _residual(lagrangian: Lagrangian, step: Array, k: int, basis: Array, work: Record) -> float:
    """Write P S x into the residual and the first search direction; returns its square."""
    root, offset, square = lagrangian.inverse_root, lagrangian.offset, 0.0
    _curvature(lagrangian, step, work, work.product[:])
    for j in range(lagrangian.n):
        work.residual[j] = work.product[offset + j] * root[offset + j]
        work.correction[j] = 0.0
    _project_out(lagrangian.n, k, basis, work.residual[:])
    for j in range(lagrangian.n):
        work.search[j] = work.residual[j]
        square += work.residual[j] * work.residual[j]
    return square


@jit
def _conjugate_gradients(lagrangian: Lagrangian, k: int, basis: Array, square: float, work: Record) -> None:
    """Solve P (I - S) P z = residual for the correction z, up to a bounded stretch where the curvature wins."""
    n, residual, search, image, correction = lagrangian.n, work.residual, work.search, work.image, work.correction
    goal = REDUCTION * square
    for _ in range(n - k):
        _apply(lagrangian, k, basis, work, search[:], image[:])
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


@jit
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
    lagrangian: Lagrangian, held: int, step: Array, rows: Rows, options: TickOptions, work: Record, qp: QpWork
) -> None:
    """Move qp.x, the solution of a program, to second order; `step` is that of all variables as far as known [m, rad].

    `held` is the number of rows of qp.basis that the correction is at right angles to: the active set, or more.
    """
    n, k, correction, end = lagrangian.n, qp.counts[0], work.correction, work.search
    tolerance, longest = options.tolerance, options.longest_correction
    if k == 0 or held >= n:
        return
    square = _residual(lagrangian, step, held, qp.basis, work)
    if square <= tolerance * tolerance:
        return
    _conjugate_gradients(lagrangian, held, qp.basis, square, work)
    length = 0.0
    for j in range(n):
        length += correction[j] * correction[j]
    scale = min(1.0, longest / math.sqrt(length)) if length > 0.0 else 0.0
    for j in range(n):
        correction[j] *= scale
        end[j] = qp.x[j] + correction[j]
    fraction = _free_share(k, rows, end[:], ROUNDING * tolerance, qp)
    for j in range(n):
        qp.x[j] += fraction * correction[j]


@jit
def _hold_bodies(n: int, problem: Record, qp: QpWork) -> int:
    """Add the bodies' columns to the basis of the active rows; return the number of its rows.

    What moves a body is what the program's multipliers put on it, by Newton's equation.
    """
    k = qp.counts[0]
    for j in range(common_count(problem)):
        is_palm = False
        for h in range(hand_count(problem)):
            is_palm = is_palm or 0 <= j - palm_column(problem, h) < 6
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
    for h in range(hand_count(problem)):
        for r in range(states[h].self_contact.count if states[h].self_contact.bends else 0):
            bends = bends or problem.own_multiplier[h, r] > 0.0
    if not still:
        square = 0.0
        for j in range(n):
            square += qp.x[j] * qp.x[j]
        bends = bends and square <= (FAR * options.longest_correction) ** 2
    if not (bends or (world.curved and still)):
        return as_bool(False)
    root = world.bending_root
    root[:] = 0.0
    for h in range(hand_count(problem)):
        palm, first = palm_column(problem, h), first_finger(problem, h)
        if still:
            copy_values(problem.inverse_root[:6], root[palm : palm + 6])
        copy_values(problem.inverse_root[6:DOF], root[first : first + FINGERS])
    loaded, first = world.loaded, as_int64(0)
    row, force = loaded.row[: loaded.count], loaded.multiplier[: loaded.count]
    lagrangian = Lagrangian(options.own, states, world, row, force, root, first, n)
    held = qp.counts[0] if still else _hold_bodies(n, problem, qp)
    correct_program(lagrangian, held, problem.delta[:], wide_rows(problem), options, world.correction, qp)
    return as_bool(True)
