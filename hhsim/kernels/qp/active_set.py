"""Dual active-set solver for small dense quadratic programs (Goldfarb & Idnani 1983).

    minimise ½ |x - x₀|²   subject to   a_i · x >= b_i,   i = 1 … m

Variables are scaled so that the Hessian is the identity: x = √G δ. The method starts at the unconstrained optimum
x₀, or at the optimum for a guessed active set, adds the most violated row and drops rows by the ratio test; every
iterate is the optimum for the rows in its active set, so the objective only rises and no first feasible point is
needed.

The normals of the active set are kept in factors that near-parallel rows do not spoil, see `kernels.qp.qr_update`. Rows
are normalised, so that the rank test is relative and violations are compared as lengths; `kernels.qp.row_scan` says how
they are stored.

Rows that contradict each other leave no solution. Between two opposed walls that the hand touches, rounding alone can
make them contradict: then all rows are moved back by the relaxation, which opens the corridor. Dropping single rows
instead would leave them unguarded in the rest of the solve.
"""

import math
from typing import Any, TypeAlias

import numpy as np

from hhsim.kernels.arithmetic import LANES
from hhsim.kernels.jit import Array, Indices, Record, as_int64, jit, jit_inline
from hhsim.kernels.qp.qr_update import append, back_substitute, project, remove, resolve, work_dtype
from hhsim.kernels.qp.row_scan import (
    ROWS_NAN,
    ROWS_ZERO,
    Rows,
    load_dense,
    most_violated,
    row_lengths,
    row_violations,
    unsound_rows,
)

QpWork: TypeAlias = Any
"""Workspace and result of a solve: a record of `qr_update.work_dtype`, made by `new_work`."""

OPTIMAL = 0
INFEASIBLE = 1
ITERATION_LIMIT = 2
NOT_FINITE = 3

RANK_TOLERANCE = 1e-10
"""Distance of a unit row from the span of the active rows below which it counts as dependent."""
WARM_RANK_TOLERANCE = 1e-6
"""Rank tolerance of guessed rows: a guess that is nearly dependent costs more than it saves."""
MULTIPLIER_TOLERANCE = 1e-13
"""Entries of the dual step direction up to this size, relative to its largest or to 1, are rounding."""

RESUMES = -1
"""Value of `guess_count`: start from the active rows of the last solve and their factors."""

DRIFT = 1e-3
"""At the end x is recomputed where rounding violates active rows by more than this share of the tolerance."""

N_MAX = 24
CAPACITY = 4160
"""Most variables and rows of a hand's programs."""


def new_work(n_max: int, capacity: int) -> QpWork:
    """Make a workspace for up to `n_max` variables and `capacity` rows; kernels compile anew for more than a hand's."""
    dtype = work_dtype(max(n_max, N_MAX), max(capacity, CAPACITY))
    # Written, so that the system allocates the pages now and not in the solves that are timed.
    memory = np.empty(1, dtype)
    memory.view(np.uint8)[:] = 0
    return memory.view(np.recarray)[0]


@jit_inline
def _load_normal(row: int, n: int, rows: Rows, work: Record) -> float:
    """Load the row's unit normal, padded; return its scale."""
    scale, normal = work.inverse_norm[row], work.normal
    for j in range(LANES * ((n + LANES - 1) // LANES)):
        normal[j] = 0.0
    if load_dense(rows, row, scale, normal):
        return scale
    for j in range(rows.n_common):
        normal[j] = rows.common[j, row] * scale
    group = 0
    while row < rows.group_start[group] or row >= rows.group_stop[group]:
        group += 1
    offset = rows.group_block[group]
    if offset >= 0:
        for j in range(3):
            normal[offset + j] = rows.block[j, row] * scale
    return scale


@jit_inline
def _rest(n: int, rhs: float, scale: float, target: Array, work: Record) -> float:
    """Compute b - a · x₀ of the loaded row, normalised."""
    total = rhs * scale
    for j in range(n):
        total -= work.normal[j] * target[j]
    return total


@jit_inline
def _drop_negative(n: int, k: int, target: Array, work: Record) -> int:
    """Drop the row of the most negative multiplier, each an iteration, until none is negative; return the rows left."""
    while True:
        resolve(n, k, target, work)
        worst, position = 0.0, as_int64(-1)
        for j in range(k):
            if work.multiplier[j] < worst:
                worst, position = work.multiplier[j], j
        if position < 0:
            return k
        remove(n, k, position, work)
        k -= 1
        work.counts[1] += 1


@jit
def _settle(n: int, k: int, target: Array, work: Record) -> float:
    """Recompute x from the factors, without the rounding of steps; return how far that moved it."""
    for j in range(n):
        work.direction[j] = work.x[j]
    resolve(n, k, target, work)
    square = 0.0
    for j in range(n):
        square += (work.x[j] - work.direction[j]) ** 2
    return math.sqrt(square)


@jit
def _take_guess(n: int, rows: Rows, target: Array, guess: Indices, guess_count: int, work: Record) -> int:
    """Begin with the active rows of the last solve, or the guessed rows that are independent; return how many."""
    k = work.counts[0] if guess_count == RESUMES else as_int64(0)
    for j in range(k):
        row = work.active[j]
        scale = _load_normal(row, n, rows, work)
        work.active_rhs[j] = _rest(n, rows.rhs[row], scale, target, work)
    for g in range(guess_count):
        row = guess[g]
        held = False
        for h in range(rows.group_start.shape[0]):
            held = held or rows.group_start[h] <= row < rows.group_stop[h]
        if k == n or not held or work.inverse_norm[row] == 0.0:
            continue
        scale = _load_normal(row, n, rows, work)
        length = math.sqrt(project(n, k, work))
        if length > WARM_RANK_TOLERANCE:
            append(n, k, row, _rest(n, rows.rhs[row], scale, target, work), length, work)
            k += 1
    return k


@jit
def _ratio_test(k: int, work: Record) -> tuple[float, int, float]:
    """Find the active row whose multiplier first falls to 0: step length, index (-1: none), 1 + Σ |dual step|."""
    largest, total = 1.0, 1.0
    for j in range(k):
        largest = max(largest, abs(work.dual_step[j]))
        total += abs(work.dual_step[j])
    limit, blocking = np.inf, as_int64(-1)
    for j in range(k):
        step = work.dual_step[j]
        if step > MULTIPLIER_TOLERANCE * largest:
            ratio = work.multiplier[j] / step
            if ratio < limit:
                limit, blocking = ratio, j
    return limit, blocking, total


@jit
def _add_row(
    n: int, k: int, row: int, rows: Rows, target: Array, relaxation: float, shift: float, work: Record
) -> tuple[int, int, float]:
    """Make a violated row active by primal and dual steps, and drop the rows that it makes inactive.

    Returns a status, the number of active rows, and the shift by which all rows are moved back.
    """
    violation = work.violation[row] - shift
    multiplier, dual_step = work.multiplier, work.dual_step
    added, limit = 0.0, 100 + 10 * n
    for g in range(rows.group_start.shape[0]):
        limit += 10 * (rows.group_stop[g] - rows.group_start[g])
    scale = _load_normal(row, n, rows, work)
    new_rhs = _rest(n, rows.rhs[row], scale, target, work) - shift
    status = OPTIMAL
    while True:
        work.counts[1] += 1
        if work.counts[1] > limit:
            status = ITERATION_LIMIT
            break
        square = project(n, k, work)
        back_substitute(k, work, work.coefficient[:], dual_step[:])
        length = math.sqrt(square)
        dual_limit, blocking, total = _ratio_test(k, work)
        independent = length > RANK_TOLERANCE and k < n
        primal_limit = violation / square if independent else np.inf
        if not independent and blocking < 0:
            # violation = yᵀb and total = Σy of Farkas' certificate y: rows moved back by their ratio agree.
            if shift == 0.0 and violation <= relaxation * total:
                shift = relaxation
                for j in range(k):
                    work.active_rhs[j] -= shift
                k = _drop_negative(n, k, target, work)
            else:
                status = INFEASIBLE
                work.counts[2] = row
            break
        step = min(dual_limit, primal_limit)
        for j in range(k):
            multiplier[j] = max(multiplier[j] - step * dual_step[j], 0.0)
        added += step
        if independent:
            for j in range(n):
                work.x[j] += step * work.direction[j]
            violation -= step * square
        if primal_limit <= dual_limit:
            append(n, k, row, new_rhs, length, work)
            multiplier[k] = added
            k += 1
            break
        remove(n, k, blocking, work)
        k -= 1
    return status, k, shift


@jit
def _judge_unsound(n: int, k: int, rows: Rows, relaxation: float, unsound: int, status: int, work: Record) -> int:
    """Judge rows of length 0 and NaN, and scale the multipliers to the rows' own length."""
    if unsound & ROWS_ZERO and status == OPTIMAL:
        for g in range(rows.group_start.shape[0]):
            for i in range(rows.group_start[g], rows.group_stop[g]):
                if work.inverse_norm[i] == 0.0 and rows.rhs[i] > relaxation and status == OPTIMAL:
                    status = INFEASIBLE
                    work.counts[2] = i
                    for j in range(k):
                        work.dual_step[j] = 0.0
    if unsound & ROWS_NAN:
        status = NOT_FINITE
    for j in range(n):
        if math.isnan(work.x[j]):
            status = NOT_FINITE
    if status == OPTIMAL:
        for j in range(k):
            work.multiplier[j] = max(work.multiplier[j], 0.0) * work.inverse_norm[work.active[j]]
    work.counts[0] = k
    return status


@jit_inline
def solve(
    n: int,
    rows: Rows,
    target: Array,
    tolerance: float,
    relaxation: float,
    guess: Indices,
    guess_count: int,
    work: QpWork,
) -> int:
    """Compute the point x nearest to `target`, x₀ of n variables, that satisfies all rows; the result is in `work`.

    A violation of `tolerance`, in units of x, counts as satisfied. By `relaxation`, in units of x, all rows are moved
    back if they contradict each other and that would reconcile them; a zero row short by no more than this, in units of
    b, counts as satisfied. `guess` are rows expected to be active; duplicates and rows that no group holds are ignored.
    `guess_count` is 0 for a cold start, RESUMES to go on from the last solve, if that ended OPTIMAL and only b has
    changed since.

    Returns OPTIMAL, INFEASIBLE, ITERATION_LIMIT, or NOT_FINITE for NaN in a row or in the target. When INFEASIBLE,
    work.counts[2] is a row whose normalised normal a equals Σ dual_step_j a_j over the active rows, where no
    dual_step_j is positive: Farkas' certificate is 1 for that row and -dual_step_j for the others.
    """
    inverse_norm, violations = work.inverse_norm[:], work.violation[:]
    shift, status = 0.0, OPTIMAL
    work.counts[1] = 0
    work.counts[2] = -1
    row_lengths(rows, inverse_norm)
    row_violations(rows, target, inverse_norm, violations)
    unsound = unsound_rows(rows, inverse_norm, violations)
    k = _take_guess(n, rows, target, guess, guess_count, work)
    known = k == 0
    k = _drop_negative(n, k, target, work)
    settled = True
    while True:
        if not known:
            row_violations(rows, work.x[:], inverse_norm, violations)
        known = False
        drift = 0.0
        for j in range(k):
            # What violates an active row is rounding.
            drift = max(drift, abs(violations[work.active[j]] - shift))
            violations[work.active[j]] = 0.0
        row = most_violated(violations, rows)
        worst = violations[row] - shift if row >= 0 else -np.inf
        if worst <= tolerance:
            # Rows are of unit length: no violation changes by more than x moves.
            if settled or drift <= DRIFT * tolerance or worst + _settle(n, k, target, work) <= tolerance:
                break
            settled = True
            continue
        # From an empty active set the step solves the row's equation directly: nothing to settle.
        settled = settled and k == 0
        status, k, shift = _add_row(n, k, row, rows, target, relaxation, shift, work)
        if status != OPTIMAL:
            break
    return _judge_unsound(n, k, rows, relaxation, unsound, status, work)
