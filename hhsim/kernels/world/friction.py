"""Friction of a program: its directions at each contact, and the slip that it is balanced against.

Directions are against load and slip, by the least friction that suffices. De Saxcé's correction sets Γ, in the rows of
friction of a loaded contact, to its slip |s|. Here Γ is max(0, |s| - φ), where φ is the gap that a contact may keep
open. While the same rows bear it, the solution is linear in the Γ of
all contacts: with N the normals of these rows, Nᵀ = Qᵀ R, and E which of them are of which contact's friction,
dx = -Qᵀ R⁻ᵀ E dΓ and dλ = -R⁻¹ R⁻ᵀ E dΓ. So

    (I - D) dΓ = |s| - φ - Γ,     D_ij = d|s_i| / dΓ_j,

is one small system, and the next program, which begins from the rows of this one, says whether they are still the same.
Where a contact's plain row bears a part of its load Γ is too large, and does nothing: it becomes |s| - φ. What Γ is
then to be at most is another such system, of the loads of the plain rows.
"""

import math
from typing import Any

import numpy as np

from hhsim.kernels.hand.kinematics import PHALANX_COUNT
from hhsim.kernels.jit import Array, Record, as_int64, jit
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.qp.qr_update import back_substitute
from hhsim.kernels.world.columns import (
    States,
    coefficient,
    common_count,
    own_columns,
    torsion_radius,
    variable_count,
    write_row,
)
from hhsim.kernels.world.rows import DIRECTIONS, TINY, orient

RANK = 1e-10
"""Share of the trace of Jᵀ J that is added to it: contacts do not tell all directions apart."""
PARTS = 1 + DIRECTIONS


def directions_dtype(dof: int, common: int, frictions: int) -> "np.dtype[Any]":
    """Build the dtype of the workspace for directions of friction, for programs of so many variables and contacts."""
    return np.dtype(
        [
            # J of each contact that bears a force: normal, then s along e_1 to e_3, scaled: common columns, then own
            ("part", np.float64, (dof, PARTS, common + PHALANX_COUNT)),
            ("matrix", np.float64, (dof, dof)),  # Jᵀ J
            ("even", np.float64, (dof,)),  # y of `_spread_evenly`
            ("next_direction", np.float64, (frictions, 4)),  # that each contact is to rub along, see `find_directions`
        ],
        align=True,
    )


@jit
def _opposite(world: Record, i: int) -> int:
    # How many rows behind that of e_k the row of its opposite is.
    return DIRECTIONS if torsion_radius(world, world.friction.contact_code[i]) > 0.0 else DIRECTIONS - 1


@jit
def _take_apart(world: Record) -> None:
    # A row and its opposite are n · Δ less and more s along one direction.
    friction, work, common, own = world.friction, world.directions, world.problem.common, world.problem.block
    width = common_count(world.problem)
    for c in range(friction.loaded_contacts):
        i = friction.loaded_contact[c]
        first, apart = friction.row[i], _opposite(world, i)
        for e in range(PARTS):
            part = work.part[c, e]
            row = first + max(e - 1, 0)
            sign = 1.0 if e == 0 else -1.0
            for j in range(width):
                part[j] = 0.5 * (common[j, row + apart] + sign * common[j, row]) if e <= apart else 0.0
            for j in range(PHALANX_COUNT):
                part[width + j] = 0.5 * (own[j, row + apart] + sign * own[j, row]) if e <= apart else 0.0


@jit
def _spread_evenly(world: Record) -> None:
    # Solve (Jᵀ J) y = Jᵀ f for the forces f that contacts with friction bear: J y are the least that do the same.
    problem, friction, loaded, work = world.problem, world.friction, world.loaded, world.directions
    common, own, matrix, y = problem.common, problem.block, work.matrix, work.even
    width, dof = common_count(problem), variable_count(problem)
    for a in range(dof):
        y[a] = 0.0
        for b in range(a + 1):
            matrix[a, b] = 0.0
    for k in range(loaded.count):
        row, size = loaded.row[k], loaded.multiplier[k]
        i = problem.owner[row]
        if i < 0 or friction.has_friction[i] == 0:
            continue
        block = own_columns(problem, friction.contact_code[i])
        for j in range(width):
            y[j] += size * common[j, row]
        if block >= 0:
            for j in range(PHALANX_COUNT):
                y[block + j] += size * own[j, row]
    trace = 0.0
    for c in range(friction.loaded_contacts):
        i = friction.loaded_contact[c]
        block = own_columns(problem, friction.contact_code[i])
        for e in range(1 + _opposite(world, i)):
            part = work.part[c, e]
            for a in range(width):
                trace += part[a] * part[a]
                for b in range(a + 1):
                    matrix[a, b] += part[a] * part[b]
            if block >= 0:
                for a in range(PHALANX_COUNT):
                    trace += part[width + a] * part[width + a]
                    for b in range(width):
                        matrix[block + a, b] += part[width + a] * part[b]
                    for b in range(a + 1):
                        matrix[block + a, block + b] += part[width + a] * part[width + b]
    for a in range(dof):
        matrix[a, a] += RANK * trace
        for b in range(a + 1):
            total = matrix[a, b]
            for j in range(b):
                total -= matrix[a, j] * matrix[b, j]
            matrix[a, b] = math.sqrt(max(total, RANK * RANK * trace)) if a == b else total / matrix[b, b]
    for a in range(dof):
        for j in range(a):
            y[a] -= matrix[a, j] * y[j]
        y[a] /= matrix[a, a]
    for k in range(dof):
        a = dof - 1 - k
        for j in range(a + 1, dof):
            y[a] -= matrix[j, a] * y[j]
        y[a] /= matrix[a, a]


@jit
def _add_evenly(c: int, i: int, world: Record) -> None:
    friction, work, width = world.friction, world.directions, common_count(world.problem)
    direction, y, block = work.next_direction[i], work.even, own_columns(world.problem, friction.contact_code[i])
    for e in range(DIRECTIONS):
        part = work.part[c, 1 + e]
        size = 0.0
        for j in range(width):
            size -= part[j] * y[j]
        if block >= 0:
            for j in range(PHALANX_COUNT):
                size -= part[width + j] * y[block + j]
        for j in range(3):
            direction[j] += size * friction.along[i, e, j]
        direction[3] += size * friction.about[i, e]


@jit
def find_directions(floats: float, world: Record) -> None:
    """Find which way the contacts that rub are to rub next, shape (contacts, 4): along the surface, about the normal.

    That is a contact's friction force, and what its slip would add to it were it held [N]; without a load, the slip
    itself [m]. What sticks keeps its e_1. Contacts about to slip, by no more than a contact may float [m], can push
    against each other with any force; the least one counts, since what is beyond takes from their cones.
    """
    problem, friction, loaded, work = world.problem, world.friction, world.loaded, world.directions
    direction, even = work.next_direction, False
    for i in range(friction.count):
        for j in range(3):
            direction[i, j] = friction.slip[i, j]
        direction[i, 3] = friction.spin[i]
    slides = False
    for c in range(friction.loaded_contacts):
        i = friction.loaded_contact[c]
        slides = slides or friction.length[i] > TINY
        even = even or TINY < friction.length[i] <= floats
    if slides:
        _take_apart(world)
    if even:
        _spread_evenly(world)
    for c in range(friction.loaded_contacts):
        i = friction.loaded_contact[c]
        if friction.length[i] <= TINY:
            for j in range(3):
                direction[i, j] = friction.along[i, 0, j]
            direction[i, 3] = friction.about[i, 0]
            continue
        give = 0.0
        for j in range(work.part.shape[2]):
            give += work.part[c, 1, j] ** 2
        stiffness = 1.0 / give if give > 0.0 else 1.0
        for j in range(4):
            direction[i, j] *= stiffness
        if friction.length[i] <= floats:
            _add_evenly(c, i, world)
    for k in range(loaded.count):
        row = loaded.row[k]
        i, kind = problem.owner[row], problem.kind[row]
        if kind == 0 or i < 0 or friction.length[i] <= floats:
            continue
        e = (kind - 1) % DIRECTIONS
        size = loaded.multiplier[k] if kind <= DIRECTIONS else -loaded.multiplier[k]
        for j in range(3):
            direction[i, j] += size * friction.along[i, e, j]
        direction[i, 3] += size * friction.about[i, e]


NO_LOAD = 1e-3
"""A contact whose normal row bears no more than this share of its load rubs with all of it."""
LEAST_PIVOT = 1e-3
"""A system with a pivot smaller than this, as a share of its largest entry or of 1, says nothing of its unknown."""
MOST_WAIT = 3
"""After each search for Γ that came to nothing in a row twice as many ticks go without one, up to this power of 2."""


def coulomb_dtype(dof: int, frictions: int) -> "np.dtype[Any]":
    """Build the dtype of the workspace of a step of Newton's method; its first axis is that of its contacts."""
    return np.dtype(
        [
            ("contact", np.int64, (dof,)),  # their places among the contacts with friction
            ("moved", np.float64, (dof, dof)),  # what a metre of Γ adds to the program's variables, scaled
            ("matrix", np.float64, (dof, dof)),  # I - D; or dλ / dΓ of plain rows [N/m]
            ("rhs", np.float64, (dof,)),  # what Γ is short of, then dΓ [m]; or the loads of plain rows [N], then dΓ
            ("share", np.float64, (dof,)),  # scratch
            ("shift", np.float64, (frictions,)),  # Γ of the round before [m]
            ("along", np.float64, (frictions, 3)),  # e_1 of the round before
            ("about", np.float64, (frictions,)),  # its part about the normal
            ("row", np.int64, (dof,)),  # loaded rows of the round before
            ("rows", np.int64),  # number of these
            ("failures", np.int64),  # searches in a row that came to nothing
            ("wait", np.int64),  # ticks that go without one
        ],
        align=True,
    )


@jit
def _raise_shift(contact: int, problem: Record, qp: QpWork, share_out: Array) -> None:
    # What a metre of Γ of a contact adds to the solution's coordinates in the basis of its rows.
    column = qp.column
    reached = False
    for i in range(qp.counts[0]):
        row = qp.active[i]
        total = 0.0
        if problem.owner[row] == contact and problem.kind[row] > 0:
            total = -qp.inverse_norm[row]
            reached = True
        if reached:
            for j in range(i):
                total -= column[i, j] * share_out[j]
            total *= qp.inverse_diagonal[i]
        share_out[i] = total


@jit
def _find_moved(friction: Record, problem: Record, qp: QpWork, work: Record) -> None:
    for c in range(friction.loaded_contacts):
        moved, share = work.moved[c], work.share
        _raise_shift(friction.loaded_contact[c], problem, qp, share[:])
        for j in range(variable_count(problem)):
            moved[j] = 0.0
        for i in range(qp.counts[0]):
            if share[i] != 0.0:
                for j in range(variable_count(problem)):
                    moved[j] += share[i] * qp.basis[i, j]


@jit
def _fill_system(floats: float, states: States, world: Record) -> None:
    problem, friction, work = world.problem, world.friction, world.coulomb
    common, own = problem.common, problem.block
    scratch = as_int64(common.shape[1] - 1)
    count = friction.loaded_contacts
    for a in range(count):
        i = friction.loaded_contact[a]
        slip = friction.length[i]
        work.contact[a] = i
        work.rhs[a] = max(0.0, slip - floats) - friction.shift[i]
        for c in range(count):
            work.matrix[a, c] = 1.0 if a == c else 0.0
        if slip <= floats or friction.plain_load[i] > NO_LOAD * (friction.plain_load[i] + friction.cone_load[i]):
            continue
        scale = 1.0 / slip
        x, y, z = scale * friction.slip[i, 0], scale * friction.slip[i, 1], scale * friction.slip[i, 2]
        spin = scale * friction.spin[i]
        contact_code, n = friction.contact_code[i], friction.normal[i]
        mu, w = coefficient(world, contact_code), torsion_radius(world, contact_code) * spin
        point = friction.point[i]
        turn = (w * n[0], w * n[1], w * n[2])
        write_row(states, world, contact_code, scratch, point, (mu * x, mu * y, mu * z), turn, 0.0)
        block = own_columns(problem, contact_code)
        for c in range(count):
            moved = work.moved[c]
            total = 0.0
            for j in range(common_count(problem)):
                total += common[j, scratch] * moved[j]
            if block >= 0:
                for j in range(PHALANX_COUNT):
                    total += own[j, scratch] * moved[block + j]
            work.matrix[a, c] -= total


@jit
def _solve_system(count: int, work: Record) -> None:
    # Elimination with pivots by rows; an unknown of which the system says nothing does not change.
    matrix, rhs = work.matrix, work.rhs
    largest = 1.0
    for a in range(count):
        for c in range(count):
            largest = max(largest, abs(matrix[a, c]))
    for c in range(count):
        pivot = as_int64(c)
        for a in range(c + 1, count):
            if abs(matrix[a, c]) > abs(matrix[pivot, c]):
                pivot = as_int64(a)
        if pivot != c:
            rhs[c], rhs[pivot] = rhs[pivot], rhs[c]
            for j in range(c, count):
                matrix[c, j], matrix[pivot, j] = matrix[pivot, j], matrix[c, j]
        if abs(matrix[c, c]) < LEAST_PIVOT * largest:
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


@jit
def next_slips(floats: float, states: States, world: Record, qp: QpWork) -> None:
    """Set Γ of the contacts that bear a force to their slip less what a contact may float [m], and turn them to it.

    Γ and e_1 of all contacts, and which rows are loaded, are kept for `end_search`.
    """
    friction, loaded, work = world.friction, world.loaded, world.coulomb
    for i in range(friction.count):
        work.shift[i] = friction.shift[i]
        work.about[i] = friction.about[i, 0]
        for j in range(3):
            work.along[i, j] = friction.along[i, 0, j]
    work.rows = loaded.count
    for j in range(loaded.count):
        work.row[j] = loaded.row[j]
    _find_moved(friction, world.problem, qp, work)
    _fill_system(floats, states, world)
    _solve_system(friction.loaded_contacts, work)
    for c in range(friction.loaded_contacts):
        i = friction.loaded_contact[c]
        friction.shift[i] = max(0.0, friction.shift[i] + work.rhs[c])
    find_directions(floats, world)
    for c in range(friction.loaded_contacts):
        i, direction = friction.loaded_contact[c], world.directions.next_direction[friction.loaded_contact[c]]
        if friction.length[i] > TINY:
            orient(friction, i, direction[0], direction[1], direction[2], direction[3])


@jit
def lower_slips(floats: float, backs: float, problem: Record, friction: Record, qp: QpWork, work: Record) -> int:
    """Lower Γ of the contacts whose plain row bears load, to the slip that they have once it bears none.

    There Γ is too large, and friction less than the law's. Where it is too small a contact floats by what is missing,
    and all is right about its force. Γ is to be `floats` [m] less than the slip, and is `backs` [m] more where the
    plain row bears for the last time. Returns how many it has lowered, whose places are the first of `contact`.
    """
    count = as_int64(0)
    for c in range(friction.loaded_contacts):
        i = friction.loaded_contact[c]
        plain = friction.plain_load[i]
        if plain > NO_LOAD * (plain + friction.cone_load[i]) and friction.shift[i] > 0.0:
            work.contact[count] = i
            work.rhs[count] = -plain
            count += 1
    k, change = qp.counts[0], qp.dual_step
    for c in range(count):
        _raise_shift(work.contact[c], problem, qp, work.share[:])
        back_substitute(k, qp, work.share[:], change[:])
        for a in range(count):
            work.matrix[a, c] = 0.0
            for j in range(k):
                row = qp.active[j]
                if problem.owner[row] == work.contact[a] and problem.kind[row] == 0:
                    work.matrix[a, c] += qp.inverse_norm[row] * change[j]
    _solve_system(count, work)
    for c in range(count):
        i = work.contact[c]
        shift = friction.shift[i] + work.rhs[c] - backs - floats
        if not work.rhs[c] < 0.0:
            # The loads say nothing of it: what counts is the slip along e_1.
            slip = friction.spin[i] * friction.about[i, 0]
            for j in range(3):
                slip += friction.slip[i, j] * friction.along[i, 0, j]
            shift = min(friction.shift[i], slip - floats)
        friction.shift[i] = max(0.0, shift)
    return count


@jit
def end_search(friction: Record, loaded: Record, work: Record) -> None:
    """Return to the best slips of a search that failed; what lets go at once slips on from tick to tick instead."""
    for i in range(friction.count):
        if friction.has_friction[i] == 1:
            friction.shift[i] = work.shift[i]
            orient(friction, i, work.along[i, 0], work.along[i, 1], work.along[i, 2], work.about[i])
    loaded.count = work.rows
    for j in range(work.rows):
        loaded.row[j] = work.row[j]
    work.failures = min(work.failures + 1, MOST_WAIT)
    work.wait = 2**work.failures
