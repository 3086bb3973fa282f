"""Dual active-set solver for small dense quadratic programs (Goldfarb & Idnani 1983).

    minimise ½ |x - x₀|²   subject to   a_i · x >= b_i,   i = 1 … m

Variables are scaled so that the Hessian is the identity: x = √G δ. The method starts at the unconstrained optimum
x₀, or at the optimum for a guessed active set, adds the most violated row and drops rows by the ratio test; every
iterate is the optimum for the rows in its active set, so the objective only rises and no first feasible point is
needed.

The normals of the active set are kept as Q R, Q with orthonormal rows by Gram-Schmidt, done twice (Daniel, Gragg,
Kaufman & Stewart 1976): contact patches bring duplicate and near-parallel rows, and the Gram matrix would lose half
the digits on them. Rows are normalised, so that the rank test is relative and violations are compared as lengths.

Rows that contradict each other leave no solution. Between two opposed walls that the hand touches, rounding alone makes
them contradict: such rows are all moved back by the relaxation, which no longer leaves the corridor empty. Giving up
single rows instead would leave them unguarded in the rest of the solve.

Rows are stored as a structure of arrays in groups: all rows share `common` columns 0 … n_common - 1; the rows of group
g have three more in `block`, which stand for the variables group_block[g] … + 2 (none where it is negative). A contact
of the coupled problem thus takes 9 numbers, not 21.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .jit import as_int64, jit, jit_vector

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

OPTIMAL = 0
INFEASIBLE = 1
ITERATION_LIMIT = 2
NOT_FINITE = 3

RANK_TOLERANCE = 1e-10
"""A unit row whose part outside the span of the active rows is shorter than this counts as dependent on them."""
WARM_RANK_TOLERANCE = 1e-6
"""Stricter for guessed rows: a guess that is nearly dependent costs more than it saves."""
MULTIPLIER_TOLERANCE = 1e-13
"""Entries of the dual step direction up to this size, relative to its largest or to 1, are rounding."""


class QpWork(NamedTuple):
    """Workspace and result of one solve; nothing in it need be set before.

    | field | meaning | shape |
    |---|---|---|
    | x | solution | (n_max,) |
    | active | rows of the active set | (n_max + 1,) |
    | multiplier | their multipliers, >= 0, for rows as given (not normalised) | (n_max + 1,) |
    | counts | [size of the active set, iterations, row that proves it infeasible or -1] | (3,) |
    | basis | orthonormal rows, of which the active normals are combinations | (n_max, n_max) |
    | triangle | upper triangular, active normal j = Σ_i triangle[i, j] basis[i] | (n_max, n_max) |
    | active_rhs | b - a · x₀ of the active rows, normalised | (n_max,) |
    | normal, direction | the row being added, and its part outside the span | (n_max,) |
    | coefficient, dual_step | its coordinates in the basis, and the dual direction | (n_max,) |
    | violation | b - a · x of every row, normalised | (row capacity,) |
    | inverse_norm | 1 / |a|, 0 for a zero row | (row capacity,) |
    | slack | room for a second look at the rows, see `kernels.second_order` | (row capacity,) |
    """

    x: Array
    active: Indices
    multiplier: Array
    counts: Indices
    basis: Array
    triangle: Array
    active_rhs: Array
    normal: Array
    direction: Array
    coefficient: Array
    dual_step: Array
    violation: Array
    inverse_norm: Array
    slack: Array


def new_work(n_max: int, capacity: int) -> QpWork:
    """Workspace for problems of up to `n_max` variables and `capacity` rows."""
    return QpWork(
        x=np.zeros(n_max),
        active=np.zeros(n_max + 1, dtype=np.int64),
        multiplier=np.zeros(n_max + 1),
        counts=np.zeros(3, dtype=np.int64),
        basis=np.zeros((n_max, n_max)),
        triangle=np.zeros((n_max, n_max)),
        active_rhs=np.zeros(n_max),
        normal=np.zeros(n_max),
        direction=np.zeros(n_max),
        coefficient=np.zeros(n_max),
        dual_step=np.zeros(n_max),
        violation=np.zeros(capacity),
        inverse_norm=np.zeros(capacity),
        slack=np.zeros(capacity),
    )


@jit_vector
def _norms(
    n_common: int,
    common: Array,
    block: Array,
    group_start: Indices,
    group_stop: Indices,
    group_block: Indices,
    inverse_norm: Array,
) -> None:
    for g in range(group_block.shape[0]):
        start, stop = group_start[g], group_stop[g]
        if group_block[g] >= 0:
            for i in range(start, stop):
                inverse_norm[i] = block[0, i] * block[0, i] + block[1, i] * block[1, i] + block[2, i] * block[2, i]
        else:
            for i in range(start, stop):
                inverse_norm[i] = 0.0
        j = 0
        while j + 2 < n_common:
            for i in range(start, stop):
                a, b, c = common[j, i], common[j + 1, i], common[j + 2, i]
                inverse_norm[i] += a * a + b * b + c * c
            j += 3
        while j < n_common:
            for i in range(start, stop):
                inverse_norm[i] += common[j, i] * common[j, i]
            j += 1
        for i in range(start, stop):
            square = inverse_norm[i]
            inverse_norm[i] = 1.0 / math.sqrt(square) if square > 0.0 else 0.0


@jit_vector
def row_violations(
    n_common: int,
    common: Array,
    block: Array,
    rhs: Array,
    group_start: Indices,
    group_stop: Indices,
    group_block: Indices,
    x: Array,
    inverse_norm: Array,
    violation: Array,
) -> None:
    """Violation b - a · x of every row, normalised; arguments as in `solve`."""
    for g in range(group_block.shape[0]):
        start, stop = group_start[g], group_stop[g]
        offset = group_block[g]
        if offset >= 0:
            x0, x1, x2 = x[offset], x[offset + 1], x[offset + 2]
            for i in range(start, stop):
                violation[i] = rhs[i] - block[0, i] * x0 - block[1, i] * x1 - block[2, i] * x2
        else:
            for i in range(start, stop):
                violation[i] = rhs[i]
        j = 0
        while j + 2 < n_common:
            x0, x1, x2 = x[j], x[j + 1], x[j + 2]
            for i in range(start, stop):
                violation[i] -= common[j, i] * x0 + common[j + 1, i] * x1 + common[j + 2, i] * x2
            j += 3
        while j < n_common:
            x0 = x[j]
            for i in range(start, stop):
                violation[i] -= common[j, i] * x0
            j += 1
        for i in range(start, stop):
            violation[i] *= inverse_norm[i]


@jit_vector
def _largest(values: Array, start: int, stop: int) -> float:
    best = -1e300
    for i in range(start, stop):
        v = values[i]
        best = v if v > best else best
    return best


@jit_vector
def _dot(a: Array, b: Array, n: int) -> float:
    total = 0.0
    for i in range(n):
        total += a[i] * b[i]
    return total


@jit
def _load_normal(
    row: int,
    n: int,
    n_common: int,
    common: Array,
    block: Array,
    group_start: Indices,
    group_stop: Indices,
    group_block: Indices,
    scale: float,
    normal_out: Array,
) -> None:
    for j in range(n):
        normal_out[j] = 0.0
    for j in range(n_common):
        normal_out[j] = common[j, row] * scale
    group = 0
    while row < group_start[group] or row >= group_stop[group]:
        group += 1
    offset = group_block[group]
    if offset >= 0:
        for j in range(3):
            normal_out[offset + j] = block[j, row] * scale


@jit_vector
def _project(n: int, k: int, basis: Array, normal: Array, coefficient: Array, direction: Array) -> None:
    # Gram-Schmidt twice: the second pass removes what rounding left of the first.
    for j in range(n):
        direction[j] = normal[j]
    for i in range(k):
        coefficient[i] = 0.0
    # Four rows at a time keep the vector unit busy, where one waits for the other's sum.
    for _ in range(2):
        i = 0
        while i + 3 < k:
            c0, c1, c2, c3 = 0.0, 0.0, 0.0, 0.0
            for j in range(n):
                d = direction[j]
                c0 += basis[i, j] * d
                c1 += basis[i + 1, j] * d
                c2 += basis[i + 2, j] * d
                c3 += basis[i + 3, j] * d
            coefficient[i] += c0
            coefficient[i + 1] += c1
            coefficient[i + 2] += c2
            coefficient[i + 3] += c3
            for j in range(n):
                direction[j] -= c0 * basis[i, j] + c1 * basis[i + 1, j] + c2 * basis[i + 2, j] + c3 * basis[i + 3, j]
            i += 4
        while i < k:
            c = 0.0
            for j in range(n):
                c += basis[i, j] * direction[j]
            coefficient[i] += c
            for j in range(n):
                direction[j] -= c * basis[i, j]
            i += 1


@jit
def _back_substitute(k: int, triangle: Array, rhs: Array, solution: Array) -> None:
    for i in range(k - 1, -1, -1):
        total = rhs[i]
        for j in range(i + 1, k):
            total -= triangle[i, j] * solution[j]
        solution[i] = total / triangle[i, i]


@jit
def _append(k: int, n: int, row: int, rhs: float, length: float, work: QpWork) -> None:
    inverse = 1.0 / length
    for j in range(n):
        work.basis[k, j] = work.direction[j] * inverse
    for i in range(k):
        work.triangle[i, k] = work.coefficient[i]
    work.triangle[k, k] = length
    work.active[k] = row
    work.active_rhs[k] = rhs


@jit
def _remove(k: int, n: int, position: int, work: QpWork) -> None:
    triangle, basis = work.triangle, work.basis
    for j in range(position, k - 1):
        work.active[j] = work.active[j + 1]
        work.multiplier[j] = work.multiplier[j + 1]
        work.active_rhs[j] = work.active_rhs[j + 1]
        for i in range(j + 2):
            triangle[i, j] = triangle[i, j + 1]
    for i in range(position, k - 1):
        a, b = triangle[i, i], triangle[i + 1, i]
        if b == 0.0:
            continue
        length = math.hypot(a, b)
        c, s = a / length, b / length
        triangle[i, i] = length
        triangle[i + 1, i] = 0.0
        for j in range(i + 1, k - 1):
            a, b = triangle[i, j], triangle[i + 1, j]
            triangle[i, j] = c * a + s * b
            triangle[i + 1, j] = c * b - s * a
        for j in range(n):
            a, b = basis[i, j], basis[i + 1, j]
            basis[i, j] = c * a + s * b
            basis[i + 1, j] = c * b - s * a


@jit
def _resolve(k: int, n: int, target: Array, work: QpWork) -> None:
    # The optimum with the active rows as equations, straight from the factors, so that no rounding is carried along:
    # x = x₀ + Qᵀ y with Rᵀ y = b - N x₀, and the multipliers from R u = y.
    y = work.coefficient
    for i in range(k):
        total = work.active_rhs[i]
        for j in range(i):
            total -= work.triangle[j, i] * y[j]
        y[i] = total / work.triangle[i, i]
    for j in range(n):
        work.x[j] = target[j]
    for i in range(k):
        for j in range(n):
            work.x[j] += y[i] * work.basis[i, j]
    _back_substitute(k, work.triangle, y, work.multiplier)


@jit
def _drop_negative(k: int, n: int, target: Array, work: QpWork) -> int:
    # Equations are a valid start once no multiplier is negative; dropping one may turn others negative.
    _resolve(k, n, target, work)
    while True:
        worst, position = 0.0, as_int64(-1)
        for j in range(k):
            if work.multiplier[j] < worst:
                worst, position = work.multiplier[j], j
        if position < 0:
            return k
        _remove(k, n, position, work)
        k -= 1
        _resolve(k, n, target, work)


@jit
def solve(
    n: int,
    n_common: int,
    common: Array,
    block: Array,
    rhs: Array,
    group_start: Indices,
    group_stop: Indices,
    group_block: Indices,
    target: Array,
    tolerance: float,
    relaxation: float,
    guess: Indices,
    guess_count: int,
    work: QpWork,
) -> int:
    """Nearest point x to `target` that satisfies all rows.

    Args:
        n: number of variables.
        n_common: number of columns that all rows share.
        common: shape (>= n_common, capacity).
        block: shape (3, capacity), see the module's text.
        rhs: b, shape (capacity,).
        group_start: first row of each group, shape (groups,).
        group_stop: row after the last of each group, shape (groups,); no row may be in two groups.
        group_block: first variable of each group's block, -1 for none, shape (groups,).
        target: x₀, shape (n,).
        tolerance: largest violation, in units of x, that counts as satisfied.
        relaxation: where rows contradict each other, and moving each of them by no more than this, in units of x, would
            reconcile them, all are moved by this much; a zero row short by no more than this, in units of b, counts
            as satisfied.
        guess: rows expected to be active, shape (>= guess_count,); duplicates and rows that no group holds are ignored.
        guess_count: how many; 0 for a cold start.
        work: workspace and result.

    Returns:
        OPTIMAL, INFEASIBLE, ITERATION_LIMIT, or NOT_FINITE for NaN in a row or in the target. When INFEASIBLE,
        work.counts[2] is a row whose normalised normal a equals Σ dual_step_j a_j over the active rows with no
        positive dual_step: Farkas' certificate is 1 for that row and -dual_step_j for the others.
    """
    groups = group_block.shape[0]
    rows = 0
    for g in range(groups):
        rows += group_stop[g] - group_start[g]
    limit = 100 + 10 * (n + rows)
    iterations = 0
    shift = 0.0
    k = as_int64(0)
    work.counts[2] = -1
    _norms(n_common, common, block, group_start, group_stop, group_block, work.inverse_norm)
    inverse_norm = work.inverse_norm

    for g in range(guess_count):
        row = guess[g]
        held = False
        for h in range(groups):
            held = held or group_start[h] <= row < group_stop[h]
        if k == n or not held or inverse_norm[row] == 0.0:
            continue
        scale = inverse_norm[row]
        _load_normal(row, n, n_common, common, block, group_start, group_stop, group_block, scale, work.normal)
        _project(n, k, work.basis, work.normal, work.coefficient, work.direction)
        length = math.sqrt(_dot(work.direction, work.direction, n))
        if length > WARM_RANK_TOLERANCE:
            _append(k, n, row, rhs[row] * scale - _dot(work.normal, target, n), length, work)
            k += 1
    guessed = k
    k = _drop_negative(k, n, target, work)
    iterations += guessed - k

    status = OPTIMAL
    settled = True
    while True:
        row_violations(
            n_common, common, block, rhs, group_start, group_stop, group_block, work.x, inverse_norm, work.violation
        )
        for j in range(k):
            work.violation[work.active[j]] = 0.0
        worst, worst_group = -np.inf, as_int64(0)
        for g in range(groups):
            candidate = _largest(work.violation, group_start[g], group_stop[g])
            if candidate > worst:
                worst, worst_group = candidate, g
        if worst - shift <= tolerance:
            if settled:
                break
            _resolve(k, n, target, work)
            settled = True
            continue
        row = group_start[worst_group]
        while work.violation[row] != worst:
            row += 1
        settled = False
        scale = inverse_norm[row]
        violation = worst - shift
        new_multiplier = 0.0
        _load_normal(row, n, n_common, common, block, group_start, group_stop, group_block, scale, work.normal)
        new_rhs = rhs[row] * scale - shift - _dot(work.normal, target, n)
        while True:
            iterations += 1
            if iterations > limit:
                status = ITERATION_LIMIT
                break
            _project(n, k, work.basis, work.normal, work.coefficient, work.direction)
            _back_substitute(k, work.triangle, work.coefficient, work.dual_step)
            square = _dot(work.direction, work.direction, n)
            length = math.sqrt(square)
            blocking = as_int64(-1)
            dual_limit = np.inf
            largest, total = 1.0, 1.0
            for j in range(k):
                largest = max(largest, abs(work.dual_step[j]))
                total += abs(work.dual_step[j])
            for j in range(k):
                step = work.dual_step[j]
                if step > MULTIPLIER_TOLERANCE * largest:
                    ratio = work.multiplier[j] / step
                    if ratio < dual_limit:
                        dual_limit, blocking = ratio, j
            independent = length > RANK_TOLERANCE and k < n
            primal_limit = violation / square if independent else np.inf
            if not independent and blocking < 0:
                # Wherever x is, some row of a Farkas certificate y is violated by yᵀb / Σy or more.
                if shift == 0.0 and violation <= relaxation * total:
                    shift = relaxation
                    for j in range(k):
                        work.active_rhs[j] -= shift
                    guessed = k
                    k = _drop_negative(k, n, target, work)
                    iterations += guessed - k
                else:
                    status = INFEASIBLE
                    work.counts[2] = row
                break
            step = min(dual_limit, primal_limit)
            for j in range(k):
                work.multiplier[j] = max(work.multiplier[j] - step * work.dual_step[j], 0.0)
            new_multiplier += step
            if independent:
                for j in range(n):
                    work.x[j] += step * work.direction[j]
                violation -= step * square
            if primal_limit <= dual_limit:
                _append(k, n, row, new_rhs, length, work)
                work.multiplier[k] = new_multiplier
                k += 1
                break
            _remove(k, n, blocking, work)
            k -= 1
        if status != OPTIMAL:
            break

    for g in range(groups):
        for i in range(group_start[g], group_stop[g]):
            if inverse_norm[i] == 0.0 and rhs[i] > relaxation and status == OPTIMAL:
                status = INFEASIBLE
                work.counts[2] = i
                for j in range(k):
                    work.dual_step[j] = 0.0
            if math.isnan(work.violation[i]):
                status = NOT_FINITE
    for j in range(n):
        if math.isnan(work.x[j]):
            status = NOT_FINITE
    if status == OPTIMAL:
        for j in range(k):
            work.multiplier[j] = max(work.multiplier[j], 0.0) * inverse_norm[work.active[j]]
    work.counts[0] = k
    work.counts[1] = iterations
    return status
