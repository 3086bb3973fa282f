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

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand.kinematics import DOF
from hhsim.kernels.jit import Record, jit, jit_once
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.qp.row_scan import row_violations
from hhsim.kernels.tick.curvature import curvature_product

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

CORRECTION_WORK = np.dtype(
    [
        ("whole", np.float64, (DOF,)),
        ("product", np.float64, (DOF,)),
        ("residual", np.float64, (DOF,)),
        ("search", np.float64, (DOF,)),
        ("image", np.float64, (DOF,)),
        ("correction", np.float64, (DOF,)),
    ],
    align=True,
)
"""Vectors of the conjugate gradients; the first two hold all 21 variables, the others those of the program."""

STRETCH = 20.0
"""Where the Lagrangian curves by less than 1 / STRETCH of the coupling, a direction is stretched by this instead."""
REDUCTION = 1e-4
"""The squared residual's reduction at which the correction is good enough: the next linearisation starts from there."""

ROUNDING = 1.0
"""Share of the program's tolerance by which a row may be violated at the corrected step and still be called kept."""


@jit
def _project_out(n: int, k: int, basis: Array, vector: Array) -> None:
    for i in range(k):
        c = 0.0
        for j in range(n):
            c += basis[i, j] * vector[j]
        for j in range(n):
            vector[j] -= c * basis[i, j]


@jit_once
def _apply(
    pose: Record,
    contacts: Record,
    inverse_root: Array,
    rows: Indices,
    multiplier: Array,
    first: int,
    last: int,
    offset: int,
    n: int,
    k: int,
    basis: Array,
    work: Record,
    vector: Array,
    image_out: Array,
) -> None:
    # P S v for a v that is zero outside the program's own variables, which begin at `offset`.
    whole, product = work.whole, work.product
    for j in range(DOF):
        whole[j] = 0.0
    for j in range(n):
        whole[offset + j] = vector[j] * inverse_root[offset + j]
    curvature_product(pose, contacts, rows, multiplier, first, last, whole[:], product[:])
    for j in range(n):
        image_out[j] = product[offset + j] * inverse_root[offset + j]
    _project_out(n, k, basis, image_out)


@jit
def correct_for_curvature(
    pose: Record,
    contacts: Record,
    inverse_root: Array,
    rows: Indices,
    multiplier: Array,
    first: int,
    last: int,
    step: Array,
    offset: int,
    n: int,
    n_common: int,
    common: Array,
    block: Array,
    rhs: Array,
    group_start: Indices,
    group_stop: Indices,
    group_block: Indices,
    tolerance: float,
    longest: float,
    work: Record,
    qp: QpWork,
) -> None:
    """Move qp.x, the solution of a program, to second order.

    Args:
        pose: The configuration of the linearisation.
        contacts: Its contact records.
        inverse_root: 1 / √G of all variables, shape (21,).
        rows: Rows with a multiplier, those of this program in [first, last).
        multiplier: Theirs [N].
        first: First place in `rows`.
        last: Behind the last place.
        step: The whole hand's step as far as it is known [m, rad], shape (21,); this program's own part included.
        offset: First of this program's variables among the 21.
        n, n_common, common, block, rhs, group_start, group_stop, group_block: The program, as in `active_set.solve`.
        tolerance: Of the program; a residual below this, in units of x, is not worth a correction.
        longest: The correction is shortened to this, in units of x.
        work: A CORRECTION_WORK record.
        qp: The solved program; its x is moved.
    """
    k = qp.counts[0]
    if k == 0 or k >= n:
        return
    residual, search, image, correction = work.residual, work.search, work.image, work.correction
    curvature_product(pose, contacts, rows, multiplier, first, last, step, work.product[:])
    for j in range(n):
        residual[j] = work.product[offset + j] * inverse_root[offset + j]
        correction[j] = 0.0
    _project_out(n, k, qp.basis, residual[:])
    square = 0.0
    for j in range(n):
        search[j] = residual[j]
        square += residual[j] * residual[j]
    if square <= tolerance * tolerance:
        return
    goal = REDUCTION * square
    for _ in range(n - k):
        _apply(
            pose,
            contacts,
            inverse_root,
            rows,
            multiplier,
            first,
            last,
            offset,
            n,
            k,
            qp.basis,
            work,
            search[:],
            image[:],
        )
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

    length = 0.0
    for j in range(n):
        length += correction[j] * correction[j]
    scale = min(1.0, longest / math.sqrt(length)) if length > 0.0 else 0.0
    for j in range(n):
        correction[j] *= scale
        search[j] = qp.x[j] + correction[j]
    # Both ends of the stretch: rows satisfied at x may fail at x + z; the first to fail bounds it. A row that says the
    # same as an active one is violated by rounding at either end: that is no failure, and would cancel the correction.
    rounding = ROUNDING * tolerance
    groups = group_block.shape[0]
    for g in range(groups):
        for i in range(group_start[g], group_stop[g]):
            qp.slack[i] = -qp.violation[i]
    row_violations(
        n_common,
        common,
        block,
        rhs,
        group_start,
        group_stop,
        group_block,
        search[:],
        qp.inverse_norm[:],
        qp.violation[:],
    )
    for j in range(k):
        qp.violation[qp.active[j]] = 0.0
    fraction = 1.0
    for g in range(groups):
        for i in range(group_start[g], group_stop[g]):
            violated = qp.violation[i]
            if violated > rounding:
                slack = max(qp.slack[i], 0.0)
                fraction = min(fraction, (slack + rounding) / (slack + violated))
    for j in range(n):
        qp.x[j] += fraction * correction[j]
