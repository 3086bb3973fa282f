"""Second-order correction of a program's solution.

The quadratic program sees flat contacts. On a curved one the hand would then approach its optimum by a constant factor
a linearisation, the slower the harder it presses: contact force times curvature works against the coupling's stiffness.
This is the step of sequential quadratic programming with the exact Hessian of the Lagrangian, G - Σ λ_i ∇²d_i, on the
active set that the program found (Nocedal & Wright 2006, ch. 18): within the null space of the active rows,

    P (I - S) P z = P S x,   S = Σ λ_i √G⁻¹ ∇²d_i √G⁻¹,

solved by conjugate gradients; where the curvature wins (z would run down a ridge) the search stops at a bounded
stretch, as in Steihaug's method. The corrected step x + z keeps the active rows, and is shortened before it violates
another one. The tick judges it by true distances like any other step.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.contact.linearise import limit_start
from hhsim.kernels.contact.own_parts import OwnParts, add_own_bends
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT
from hhsim.kernels.jit import Array, Indices, Record, as_int64, generic, jit_inline, jit_pasted
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.qp.row_scan import Rows, row_violations
from hhsim.kernels.tick.curvature import curvature_product

VECTORS = "whole", "product", "residual", "search", "image", "correction"


def correction_dtype(variables: int) -> "np.dtype[Any]":
    """Build the dtype of the conjugate gradients' vectors; the first two hold all variables, the others a program's."""
    return np.dtype([(name, np.float64, (variables,)) for name in VECTORS], align=True)


CORRECTION_WORK = correction_dtype(DOF)
"""Vectors for a hand's variables."""

FLAT_PROGRAMS = 3
"""First programs of a tick, in which a hand's own pairs do not bend: most ticks need no more, and the derivatives take
half a tick."""
STRETCH = 20.0
"""Most that a direction is stretched by, where the Lagrangian curves by less than 1 / STRETCH of the coupling."""
REDUCTION = 1e-4
"""Reduction of the squared residual at which the correction ends: the next linearisation starts from there."""

ROUNDING = 1.0
"""Share of the program's tolerance by which a row may be violated at the corrected step and still be called kept."""


@jit_inline
def _project_out(n: int, k: int, basis: Array, vector: Array) -> None:
    for i in range(k):
        c = 0.0
        for j in range(n):
            c += basis[i, j] * vector[j]
        for j in range(n):
            vector[j] -= c * basis[i, j]


class Lagrangian(NamedTuple):
    """Curved part of a program: its contacts that carry a multiplier, and the hand's variables that it has."""

    own: OwnParts  # pairs of the hand's own parts that may meet
    pose: Record  # the configuration of the linearisation
    contacts: Record  # its contact records
    parts: Record  # rows of the hand's own parts
    row: Indices  # rows with a multiplier, (>= loaded,)
    multiplier: Array  # theirs [N], (>= loaded,)
    loaded: int  # how many
    inverse_root: Array  # 1 / √G of all variables, (21,)
    offset: int  # the program's variables are n of the 21, from here on
    n: int


# Put into its callers before they are lowered: a function cannot return records.
@jit_pasted
def lagrangian_of(own: OwnParts, state: Record, solution: Record, offset: int, n: int) -> Lagrangian:
    """Return the curved part of a program at the state's pose, by the rows and multipliers of its solution."""
    row, multiplier, inverse_root = solution.row[:], solution.multiplier[:], state.problem.inverse_root[:]
    given = state.pose, state.contacts, state.self_contact
    return Lagrangian(own, *given, row, multiplier, solution.count, inverse_root, offset, n)


@generic
def curvature(lagrangian: Any, step: Array, product_out: Array) -> None:
    """Compute Σ λ ∇²d · step over the loaded contacts of a program, for a step of all variables [m, rad]."""


@curvature.of(Lagrangian)
@jit_inline
def _curvature(lagrangian: Lagrangian, step: Array, product_out: Array) -> None:
    pose, contacts, loaded = lagrangian.pose, lagrangian.contacts, lagrangian.loaded
    row, multiplier, first = lagrangian.row, lagrangian.multiplier, limit_start(contacts, as_int64(FINGER_COUNT))
    curvature_product(pose, contacts, row, multiplier, loaded, step, product_out)
    if lagrangian.parts.bends:
        force, root = multiplier[:loaded], lagrangian.inverse_root
        add_own_bends(lagrangian.own, pose, lagrangian.parts, first, row[:loaded], force, root, step, product_out)


@jit_inline
def _apply(lagrangian: Any, k: int, basis: Array, work: Record, vector: Array, image_out: Array) -> None:
    # P S v for a v that is zero outside the program's own variables, which begin at `offset`.
    whole, product = work.whole, work.product
    inverse_root, offset, n = lagrangian.inverse_root, lagrangian.offset, lagrangian.n
    for j in range(whole.shape[0]):
        whole[j] = 0.0
    for j in range(n):
        whole[offset + j] = vector[j] * inverse_root[offset + j]
    curvature(lagrangian, whole[:], product[:])
    for j in range(n):
        image_out[j] = product[offset + j] * inverse_root[offset + j]
    _project_out(n, k, basis, image_out)


@jit_inline
def _residual(lagrangian: Any, step: Array, k: int, basis: Array, work: Record) -> float:
    """Write P S x into the residual and the first search direction; returns its square."""
    inverse_root, offset = lagrangian.inverse_root, lagrangian.offset
    curvature(lagrangian, step, work.product[:])
    for j in range(lagrangian.n):
        work.residual[j] = work.product[offset + j] * inverse_root[offset + j]
        work.correction[j] = 0.0
    _project_out(lagrangian.n, k, basis, work.residual[:])
    square = 0.0
    for j in range(lagrangian.n):
        work.search[j] = work.residual[j]
        square += work.residual[j] * work.residual[j]
    return square


@jit_inline
def _conjugate_gradients(lagrangian: Any, k: int, basis: Array, square: float, work: Record) -> None:
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


@jit_inline
def correct_for_curvature(
    lagrangian: Any, held: int, step: Array, rows: Rows, tolerance: float, longest: float, work: Record, qp: QpWork
) -> None:
    """Move qp.x, the solution of a program, to second order.

    `held` is the number of rows of qp.basis that the correction is at right angles to: the active set, or more.
    `lagrangian` has the fields `inverse_root`, `offset` and `n` of `Lagrangian`, and an implementation of `curvature`.
    `step` is that of all its variables as far as it is known [m, rad], this program's part included. In units of x are
    `tolerance`, below which a residual is not worth a correction, and `longest`, to which the correction is shortened.
    """
    n, k, correction, end = lagrangian.n, qp.counts[0], work.correction, work.search
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
