"""Coulomb's law for the contacts of a program: Newton's method for what each of them slips, and which way it rubs.

De Saxcé's correction asks that Γ, which the rows of friction of a contact are given, is |s| of the solution, where it
bears a force; here it is to be |s| - φ, with φ what a contact may float, and 0 where it slips by less. While the same
rows bear it, the solution is linear in the Γ of all contacts: with N the normals of these rows, Nᵀ = Qᵀ R, and E which
of them are of which contact's friction, dx = -Qᵀ R⁻ᵀ E dΓ. So

    (I - D) dΓ = |s| - φ - Γ,     D_ij = d|s_i| / dΓ_j,

is one small system, and the next program, which begins from the rows of this one, says whether they are still the same.
Where a contact's plain row bears a part of its load Γ is too large, and does nothing: it becomes |s| - φ.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.free.rows import (
    COMMON,
    DIRECTIONS,
    FREE_DOF,
    FREE_ROWS,
    FRICTIONS,
    coefficient,
    orient,
    torsion_radius,
    write_row,
)
from hhsim.kernels.hand.kinematics import PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Record, as_int64, jit, jit_once
from hhsim.kernels.qp.active_set import QpWork

Array = NDArray[np.float64]

NO_LOAD = 1e-3
"""A contact whose normal row bears no more than this share of its load rubs with all of it."""
FLAT = 1e-3
"""A system with a pivot smaller than this says nothing about the unknown that it belongs to."""
RANK = 1e-10
"""Share of the trace of Jᵀ J that is added to it: contacts do not tell all directions apart."""

COULOMB = np.dtype(
    [
        ("contact", np.int64, (FREE_DOF,)),
        ("moved", np.float64, (FREE_DOF, FREE_DOF)),
        ("matrix", np.float64, (FREE_DOF, FREE_DOF)),
        ("rhs", np.float64, (FREE_DOF,)),
        ("share", np.float64, (FREE_DOF,)),
        ("shift", np.float64, (FRICTIONS,)),
        ("along", np.float64, (FRICTIONS, 3)),
        ("about", np.float64, (FRICTIONS,)),
        ("leaning", np.float64, (FRICTIONS, 4)),
        ("failures", np.int64),
        ("wait", np.int64),
    ],
    align=True,
)
"""What a step of Newton's method needs; the first axis is that of the contacts that bear a force.

| field | meaning |
|---|---|
| contact | their places in FRICTION |
| moved | what a metre of Γ adds to the program's variables, scaled |
| matrix, rhs | I - D, and what Γ is short of, then dΓ [m]; also Jᵀ J and y of `_spread_evenly` |
| share | scratch |
| shift, along, about | Γ and e_1 of the round before, as FRICTION has them |
| leaning | which way each contact is to rub next, see `find_leanings` |
| failures, wait | searches in a row that came to nothing, and ticks that go without one |
"""


@jit
def _block_of(friction: Record, i: int) -> int:
    # Where the variables of the finger of a contact begin, -1 without.
    of = friction.body[i]
    return COMMON + PHALANX_COUNT * (of // PHALANX_COUNT) if 0 <= of < PALM_BODY else -1


@jit_once
def _find_moved(count: int, problem: Record, qp: QpWork, work: Record) -> None:
    k = qp.counts[0]
    column, share = qp.column, work.share
    for c in range(count):
        of = work.contact[c]
        moved = work.moved[c]
        for j in range(FREE_DOF):
            moved[j] = 0.0
        begun = False
        for i in range(k):
            row = qp.active[i]
            total = 0.0
            if problem.owner[row] == of and problem.kind[row] > 0:
                total = -qp.inverse_norm[row]
                begun = True
            if not begun:
                share[i] = 0.0
                continue
            for j in range(i):
                total -= column[i, j] * share[j]
            total *= qp.inverse_diagonal[i]
            share[i] = total
            for j in range(FREE_DOF):
                moved[j] += total * qp.basis[i, j]


@jit_once
def _fill_system(
    count: int, pose: Record, body: Record, floats: float, problem: Record, friction: Record, work: Record
) -> None:
    scratch = as_int64(FREE_ROWS - 1)
    common, own = problem.common, problem.block
    for a in range(count):
        i = work.contact[a]
        slip = friction.length[i]
        work.rhs[a] = max(0.0, slip - floats) - friction.shift[i]
        for c in range(count):
            work.matrix[a, c] = 1.0 if a == c else 0.0
        if slip <= floats or friction.plain[i] > NO_LOAD * (friction.plain[i] + friction.cone[i]):
            continue
        scale = 1.0 / slip
        x, y, z = scale * friction.slip[i, 0], scale * friction.slip[i, 1], scale * friction.slip[i, 2]
        spin = scale * friction.spin[i]
        of, n = friction.body[i], friction.normal[i]
        mu, w = coefficient(body, of), torsion_radius(body, of) * spin
        point = friction.point[i]
        write_row(*(pose, body, problem, of, scratch, point, mu * x, mu * y, mu * z, w * n[0], w * n[1], w * n[2], 0.0))
        block = _block_of(friction, i)
        for c in range(count):
            moved = work.moved[c]
            total = 0.0
            for j in range(COMMON):
                total += common[j, scratch] * moved[j]
            if block >= 0:
                for j in range(PHALANX_COUNT):
                    total += own[j, scratch] * moved[block + j]
            work.matrix[a, c] -= total


@jit_once
def _solve_system(count: int, work: Record) -> None:
    # Elimination with pivots by rows; an unknown of which the system says nothing does not change.
    matrix, rhs = work.matrix, work.rhs
    for c in range(count):
        at = as_int64(c)
        for a in range(c + 1, count):
            if abs(matrix[a, c]) > abs(matrix[at, c]):
                at = as_int64(a)
        if at != c:
            rhs[c], rhs[at] = rhs[at], rhs[c]
            for j in range(c, count):
                matrix[c, j], matrix[at, j] = matrix[at, j], matrix[c, j]
        if abs(matrix[c, c]) < FLAT:
            matrix[c, c] = 1.0
            rhs[c] = 0.0
            for j in range(c + 1, count):
                matrix[c, j] = 0.0
        for a in range(c + 1, count):
            factor = matrix[a, c] / matrix[c, c]
            if factor != 0.0:
                rhs[a] -= factor * rhs[c]
                for j in range(c + 1, count):
                    matrix[a, j] -= factor * matrix[c, j]
    for k in range(count):
        c = count - 1 - k
        total = rhs[c]
        for j in range(c + 1, count):
            total -= matrix[c, j] * rhs[j]
        rhs[c] = total / matrix[c, c]


@jit_once
def foresee_slips(
    pose: Record,
    body: Record,
    floats: float,
    problem: Record,
    friction: Record,
    loaded: Record,
    qp: QpWork,
    work: Record,
) -> None:
    """Set Γ of the contacts that bear a force by Newton's method, and turn their directions.

    Γ is to be the slip less what a contact may float [m].
    """
    count = as_int64(0)
    for i in range(friction.count):
        if friction.rubs[i] == 1 and friction.plain[i] + friction.cone[i] > 0.0 and count < FREE_DOF:
            work.contact[count] = i
            count += 1
    _find_moved(count, problem, qp, work)
    _fill_system(count, pose, body, floats, problem, friction, work)
    _solve_system(count, work)
    for c in range(count):
        i = work.contact[c]
        friction.shift[i] = max(0.0, friction.shift[i] + work.rhs[c])
    find_leanings(body, floats, problem, friction, loaded, work)
    turn_contacts(friction, work)


@jit
def _opposite(body: Record, friction: Record, i: int) -> int:
    # How many rows behind that of e_k the row of its opposite is.
    return DIRECTIONS if torsion_radius(body, friction.body[i]) > 0.0 else DIRECTIONS - 1


@jit_once
def _spread_evenly(body: Record, problem: Record, friction: Record, loaded: Record, work: Record) -> bool:
    # Solve (Jᵀ J) y = Jᵀ f for the forces f that contacts with friction bear: J y are the least that do the same.
    common, own, matrix, y = problem.common, problem.block, work.matrix, work.rhs
    for a in range(FREE_DOF):
        y[a] = 0.0
        for b in range(a + 1):
            matrix[a, b] = 0.0
    for k in range(loaded.count):
        row, size = loaded.row[k], loaded.multiplier[k]
        i = problem.owner[row]
        if i < 0 or friction.rubs[i] == 0:
            continue
        block = _block_of(friction, i)
        for j in range(COMMON):
            y[j] += size * common[j, row]
        if block >= 0:
            for j in range(PHALANX_COUNT):
                y[block + j] += size * own[j, row]
    trace = 0.0
    part = work.share
    for i in range(friction.count):
        if friction.rubs[i] == 0 or friction.plain[i] + friction.cone[i] == 0.0:
            continue
        block, apart = _block_of(friction, i), _opposite(body, friction, i)
        for c in range(1 + apart):
            first = friction.row[i] + max(c - 1, 0)
            sign = 1.0 if c == 0 else -1.0
            for j in range(COMMON):
                part[j] = 0.5 * (common[j, first + apart] + sign * common[j, first])
            for j in range(PHALANX_COUNT):
                part[COMMON + j] = 0.5 * (own[j, first + apart] + sign * own[j, first])
            for a in range(COMMON):
                trace += part[a] * part[a]
                for b in range(a + 1):
                    matrix[a, b] += part[a] * part[b]
            if block >= 0:
                for a in range(PHALANX_COUNT):
                    trace += part[COMMON + a] * part[COMMON + a]
                    for b in range(COMMON):
                        matrix[block + a, b] += part[COMMON + a] * part[b]
                    for b in range(a + 1):
                        matrix[block + a, block + b] += part[COMMON + a] * part[COMMON + b]
    if trace == 0.0:
        return False
    for a in range(FREE_DOF):
        matrix[a, a] += RANK * trace
        for b in range(a + 1):
            total = matrix[a, b]
            for j in range(b):
                total -= matrix[a, j] * matrix[b, j]
            matrix[a, b] = math.sqrt(max(total, RANK * RANK * trace)) if a == b else total / matrix[b, b]
    for a in range(FREE_DOF):
        for j in range(a):
            y[a] -= matrix[a, j] * y[j]
        y[a] /= matrix[a, a]
    for k in range(FREE_DOF):
        a = FREE_DOF - 1 - k
        for j in range(a + 1, FREE_DOF):
            y[a] -= matrix[j, a] * y[j]
        y[a] /= matrix[a, a]
    return True


@jit
def find_leanings(body: Record, floats: float, problem: Record, friction: Record, loaded: Record, work: Record) -> None:
    """Find which way the contacts that rub are to rub next, shape (contacts, 4): along the surface, about the normal.

    That is the friction that a contact bears, and what its slip would add to it were it held [N]: what has hardly begun
    to slip turns as far as its slip relieves it, what slips far rubs against its slip. One that bears nothing: the slip
    itself [m]. Where contacts stick, what they bear against each other can be anything; they lean to the least of it,
    since what is beyond takes from their cones.
    """
    common, own, leaning = problem.common, problem.block, work.leaning
    evenly = _spread_evenly(body, problem, friction, loaded, work)
    for i in range(friction.count):
        lean = leaning[i]
        bears = friction.rubs[i] == 1 and friction.plain[i] + friction.cone[i] > 0.0
        first = friction.row[i]
        opposite = first + (_opposite(body, friction, i) if bears else 0)
        give = 0.0
        if bears:
            for j in range(COMMON):
                give += (0.5 * (common[j, opposite] - common[j, first])) ** 2
            for j in range(PHALANX_COUNT):
                give += (0.5 * (own[j, opposite] - own[j, first])) ** 2
        stiffness = 1.0 / give if give > 0.0 else 1.0
        for j in range(3):
            lean[j] = stiffness * friction.slip[i, j]
        lean[3] = stiffness * friction.spin[i]
        if bears and evenly and friction.length[i] <= floats:
            block = _block_of(friction, i)
            for e in range(opposite - first):
                size = 0.0
                for j in range(COMMON):
                    size += 0.5 * (common[j, first + e] - common[j, opposite + e]) * work.rhs[j]
                if block >= 0:
                    for j in range(PHALANX_COUNT):
                        size += 0.5 * (own[j, first + e] - own[j, opposite + e]) * work.rhs[block + j]
                for j in range(3):
                    lean[j] += size * friction.along[i, e, j]
                lean[3] += size * friction.about[i, e]
    for k in range(loaded.count):
        row = loaded.row[k]
        i, kind = problem.owner[row], problem.kind[row]
        if kind == 0 or i < 0 or (evenly and friction.length[i] <= floats):
            continue
        e = (kind - 1) % DIRECTIONS
        size = loaded.multiplier[k] if kind <= DIRECTIONS else -loaded.multiplier[k]
        for j in range(3):
            leaning[i, j] += size * friction.along[i, e, j]
        leaning[i, 3] += size * friction.about[i, e]


@jit
def turn_contacts(friction: Record, work: Record) -> None:
    """Turn the directions of the contacts that bear a force as they lean."""
    leaning = work.leaning
    for i in range(friction.count):
        if friction.rubs[i] == 1 and friction.plain[i] + friction.cone[i] > 0.0:
            orient(friction, i, leaning[i, 0], leaning[i, 1], leaning[i, 2], leaning[i, 3])


@jit
def keep_slips(friction: Record, work: Record) -> None:
    """Keep Γ and e_1 of all contacts."""
    for i in range(friction.count):
        work.shift[i] = friction.shift[i]
        work.about[i] = friction.about[i, 0]
        for j in range(3):
            work.along[i, j] = friction.along[i, 0, j]


@jit
def return_to_slips(friction: Record, work: Record) -> None:
    """Return to what was kept."""
    for i in range(friction.count):
        if friction.rubs[i] == 1:
            friction.shift[i] = work.shift[i]
            orient(friction, i, work.along[i, 0], work.along[i, 1], work.along[i, 2], work.about[i])
