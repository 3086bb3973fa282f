"""Factors of small matrices: Cholesky, and orthogonal ones that are updated row by row.

A x = b is solved by A = Uᵀ U, row-oriented and right-looking: every inner loop runs along a contiguous row, so that it
uses the vector unit in strict arithmetic, and the sums are taken in the same order on every machine.

The normals of the active rows are N = Rᵀ Q, Q with orthonormal rows by Gram-Schmidt, done a second time where the first
leaves little of the new normal (Daniel, Gragg, Kaufman & Stewart 1976): contact patches bring duplicate and
near-parallel rows, and the Gram matrix would lose half the digits on them. A row is dropped by Givens rotations.

Vectors are padded with zeros to whole multiples of `LANES`, so that loops over them have no rest and their inner part
is one instruction. Nothing in a workspace need be set before a solve.
"""

import math
from typing import Any

import numpy as np

from hhsim.kernels.arithmetic import LANES, dot, fused
from hhsim.kernels.jit import Array, Record, jit_inline

NOT_POSITIVE = 1
"""Status: a pivot is not positive and finite; the matrix is not positive definite to working precision."""


@jit_inline
def factorise(matrix: Array, count: int) -> int:
    """Replace the upper triangle of the leading `count` rows by U, the lower one unread; return 0, or NOT_POSITIVE."""
    for k in range(count):
        pivot = matrix[k, k]
        if not 0.0 < pivot < np.inf:
            return NOT_POSITIVE
        scale = 1.0 / math.sqrt(pivot)
        for j in range(k, count):
            matrix[k, j] *= scale
        for i in range(k + 1, count):
            factor = matrix[k, i]
            if factor == 0.0:
                continue
            for j in range(i, count):
                matrix[i, j] -= factor * matrix[k, j]
    return 0


@jit_inline
def solve_factorised(factor: Array, count: int, vector: Array) -> None:
    """Replace b, the leading `count` numbers of `vector`, by the solution of Uᵀ U x = b."""
    for k in range(count):
        value = vector[k] / factor[k, k]
        vector[k] = value
        for j in range(k + 1, count):
            vector[j] -= value * factor[k, j]
    for k in range(count - 1, -1, -1):
        value = vector[k]
        for j in range(k + 1, count):
            value -= factor[k, j] * vector[j]
        vector[k] = value / factor[k, k]


SECOND_PASS = 0.25
"""Squared length of a unit normal after the first pass below which its rounding needs a second one."""


def work_dtype(n_max: int, capacity: int) -> np.dtype[Any]:
    """Return the dtype of workspace and result of a solve, for up to `n_max` variables and `capacity` rows."""
    padded = -(-n_max // LANES) * LANES
    return np.dtype(
        [
            ("x", np.float64, (padded,)),  # solution
            ("active", np.int64, (padded + 1,)),  # rows of the active set
            ("multiplier", np.float64, (padded + 1,)),  # theirs, >= 0, for rows as given (not normalised)
            ("counts", np.int64, (3,)),  # size of the active set, iterations, row that proves infeasibility or -1
            ("basis", np.float64, (padded, padded)),  # Q: orthonormal rows that span the active normals
            ("column", np.float64, (padded, padded)),  # Rᵀ: active normal j = Σ_i column[j, i] basis[i], i <= j
            ("inverse_diagonal", np.float64, (padded,)),  # 1 / column[j, j]
            ("active_rhs", np.float64, (padded,)),  # b - a · x₀ of the active rows, normalised
            ("normal", np.float64, (padded,)),  # the row being added
            ("direction", np.float64, (padded,)),  # its part outside the span
            ("coefficient", np.float64, (padded,)),  # its coordinates in the basis
            ("dual_step", np.float64, (padded,)),  # dual direction
            ("share", np.float64, (padded,)),  # scratch
            ("violation", np.float64, (capacity,)),  # b - a · x of every row, normalised
            ("inverse_norm", np.float64, (capacity,)),  # 1 / |a|, 0 for a zero row
            ("slack", np.float64, (capacity,)),  # of a second scan of the rows, see `kernels.world.second_order`
        ],
        align=True,
    )


@jit_inline
def _split(chunks: int, k: int, work: Record) -> None:
    """Subtract from `direction` its part in the span of k basis rows, and add that to `coefficient`."""
    basis, direction, share = work.basis, work.direction, work.share
    for i in range(k):
        total = dot(basis[i], direction, chunks)
        share[i] = total
        work.coefficient[i] += total
    # Four rows at a time: each would wait for the other's sum.
    i = 0
    while i + 3 < k:
        s0, s1, s2, s3 = share[i], share[i + 1], share[i + 2], share[i + 3]
        for c in range(chunks):
            for lane in range(LANES):
                j = LANES * c + lane
                first = fused(s0, basis[i, j], s1 * basis[i + 1, j])
                direction[j] -= first + fused(s2, basis[i + 2, j], s3 * basis[i + 3, j])
        i += 4
    while i < k:
        s0 = share[i]
        for c in range(chunks):
            for lane in range(LANES):
                j = LANES * c + lane
                direction[j] = fused(-s0, basis[i, j], direction[j])
        i += 1


@jit_inline
def project(n: int, k: int, work: Record) -> float:
    """Split work.normal, a unit vector, into coordinates and work.direction; return the latter's squared length."""
    chunks = (n + LANES - 1) // LANES
    for j in range(LANES * chunks):
        work.direction[j] = work.normal[j]
        work.coefficient[j] = 0.0
    if k == 0:
        return dot(work.direction[:], work.direction[:], chunks)
    _split(chunks, k, work)
    square = dot(work.direction[:], work.direction[:], chunks)
    if square < SECOND_PASS:
        _split(chunks, k, work)
        square = dot(work.direction[:], work.direction[:], chunks)
    return square


@jit_inline
def back_substitute(k: int, work: Record, rhs: Array, solution: Array) -> None:
    """Solve R · solution = rhs for the first k entries, followed by zeros; rhs and solution may be one array."""
    column = work.column
    chunks = (k + LANES - 1) // LANES
    for i in range(LANES * chunks):
        solution[i] = rhs[i] if i < k else 0.0
    for j in range(k - 1, -1, -1):
        s = solution[j] * work.inverse_diagonal[j]
        for c in range((j + LANES - 1) // LANES):
            for lane in range(LANES):
                i = LANES * c + lane
                solution[i] = fused(-s, column[j, i], solution[i])
        solution[j] = s


@jit_inline
def resolve(n: int, k: int, target: Array, work: Record) -> None:
    """Compute the optimum with the active rows as equations: x = x₀ + Qᵀ y, Rᵀ y = b - N x₀, multipliers R u = y."""
    basis, x, y = work.basis, work.x, work.coefficient[:]
    chunks = (n + LANES - 1) // LANES
    for i in range(LANES * ((k + LANES - 1) // LANES)):
        y[i] = 0.0
    for i in range(k):
        total = dot(work.column[i], y, (i + LANES - 1) // LANES)
        y[i] = (work.active_rhs[i] - total) * work.inverse_diagonal[i]
    for j in range(LANES * chunks):
        x[j] = 0.0
    for i in range(k):
        s = y[i]
        for c in range(chunks):
            for lane in range(LANES):
                j = LANES * c + lane
                x[j] = fused(s, basis[i, j], x[j])
    for j in range(n):
        x[j] += target[j]
    back_substitute(k, work, y, work.multiplier[:])


@jit_inline
def append(n: int, k: int, row: int, rhs: float, length: float, work: Record) -> None:
    """Append the projected row, whose `direction` has this length, to an active set of k."""
    inverse = 1.0 / length
    for j in range(LANES * ((n + LANES - 1) // LANES)):
        work.basis[k, j] = work.direction[j] * inverse
        work.column[k, j] = work.coefficient[j]
    work.column[k, k] = length
    work.inverse_diagonal[k] = inverse
    work.active[k] = row
    work.active_rhs[k] = rhs


@jit_inline
def remove(n: int, k: int, position: int, work: Record) -> None:
    """Remove the row at a position, with its multiplier, from an active set of k."""
    column, basis, inverse_diagonal = work.column, work.basis, work.inverse_diagonal
    chunks = (n + LANES - 1) // LANES
    for j in range(position, k - 1):
        work.active[j] = work.active[j + 1]
        work.multiplier[j] = work.multiplier[j + 1]
        work.active_rhs[j] = work.active_rhs[j + 1]
        for i in range(LANES * ((j + LANES + 1) // LANES)):
            column[j, i] = column[j + 1, i]
    for i in range(position, k - 1):
        a, b = column[i, i], column[i, i + 1]
        if b == 0.0:
            inverse_diagonal[i] = 1.0 / a
            continue
        length = math.sqrt(a * a + b * b)
        inverse = 1.0 / length
        c, s = a * inverse, b * inverse
        column[i, i] = length
        column[i, i + 1] = 0.0
        inverse_diagonal[i] = inverse
        for j in range(i + 1, k - 1):
            a, b = column[j, i], column[j, i + 1]
            column[j, i] = c * a + s * b
            column[j, i + 1] = c * b - s * a
        for chunk in range(chunks):
            for lane in range(LANES):
                j = LANES * chunk + lane
                a, b = basis[i, j], basis[i + 1, j]
                basis[i, j] = c * a + s * b
                basis[i + 1, j] = c * b - s * a
