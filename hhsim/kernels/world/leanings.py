"""Directions of friction of the contacts of a program: against load and slip, by the least friction that suffices."""

import math
from typing import Any

import numpy as np

from hhsim.kernels.hand.kinematics import PHALANX_COUNT
from hhsim.kernels.jit import Record, jit
from hhsim.kernels.world.columns import common_count, own_columns, torsion_radius, variable_count
from hhsim.kernels.world.rows import DIRECTIONS, TINY, orient

RANK = 1e-10
"""Share of the trace of Jᵀ J that is added to it: contacts do not tell all directions apart."""
PARTS = 1 + DIRECTIONS


def leanings_dtype(dof: int, common: int, frictions: int) -> "np.dtype[Any]":
    """Build the dtype of the workspace for directions of friction, for programs of so many variables and contacts."""
    return np.dtype(
        [
            # J of each contact that bears a force: normal, then s along e_1 to e_3, scaled: common columns, then own
            ("part", np.float64, (dof, PARTS, common + PHALANX_COUNT)),
            ("matrix", np.float64, (dof, dof)),  # Jᵀ J
            ("even", np.float64, (dof,)),  # y of `_spread_evenly`
            ("wanted", np.float64, (frictions, 4)),  # which way each contact is to rub next, see `find_leanings`
        ],
        align=True,
    )


@jit
def _opposite(bodies: Record, problem: Record, friction: Record, i: int) -> int:
    # How many rows behind that of e_k the row of its opposite is.
    return DIRECTIONS if torsion_radius(bodies, problem, friction.body[i]) > 0.0 else DIRECTIONS - 1


@jit
def _take_apart(bodies: Record, problem: Record, friction: Record, work: Record) -> None:
    # A row and its opposite are n · Δ less and more s along one direction.
    common, own = problem.common, problem.block
    width = common_count(problem)
    for c in range(friction.bearings):
        i = friction.bearing[c]
        first, apart = friction.row[i], _opposite(bodies, problem, friction, i)
        for e in range(PARTS):
            part = work.part[c, e]
            row = first + max(e - 1, 0)
            sign = 1.0 if e == 0 else -1.0
            for j in range(width):
                part[j] = 0.5 * (common[j, row + apart] + sign * common[j, row]) if e <= apart else 0.0
            for j in range(PHALANX_COUNT):
                part[width + j] = 0.5 * (own[j, row + apart] + sign * own[j, row]) if e <= apart else 0.0


@jit
def _spread_evenly(bodies: Record, problem: Record, friction: Record, loaded: Record, work: Record) -> None:
    # Solve (Jᵀ J) y = Jᵀ f for the forces f that contacts with friction bear: J y are the least that do the same.
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
        block = own_columns(problem, friction.body[i])
        for j in range(width):
            y[j] += size * common[j, row]
        if block >= 0:
            for j in range(PHALANX_COUNT):
                y[block + j] += size * own[j, row]
    trace = 0.0
    for c in range(friction.bearings):
        i = friction.bearing[c]
        block = own_columns(problem, friction.body[i])
        for e in range(1 + _opposite(bodies, problem, friction, i)):
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
def _add_evenly(c: int, i: int, problem: Record, friction: Record, work: Record) -> None:
    lean, y, width = work.wanted[i], work.even, common_count(problem)
    block = own_columns(problem, friction.body[i])
    for e in range(DIRECTIONS):
        part = work.part[c, 1 + e]
        size = 0.0
        for j in range(width):
            size -= part[j] * y[j]
        if block >= 0:
            for j in range(PHALANX_COUNT):
                size -= part[width + j] * y[block + j]
        for j in range(3):
            lean[j] += size * friction.along[i, e, j]
        lean[3] += size * friction.about[i, e]


@jit
def find_leanings(
    bodies: Record, floats: float, problem: Record, friction: Record, loaded: Record, work: Record
) -> None:
    """Find which way the contacts that rub are to rub next, shape (contacts, 4): along the surface, about the normal.

    That is the friction that a contact bears, and what its slip would add to it were it held [N]; for one that bears
    nothing, the slip itself [m]. What sticks is right as it is, and leans to its e_1. Contacts about to slip, by no
    more than a contact may float [m], can bear anything against each other; they lean to the least of it, since what is
    beyond takes from their cones.
    """
    wanted = work.wanted
    even = False
    for i in range(friction.count):
        for j in range(3):
            wanted[i, j] = friction.slip[i, j]
        wanted[i, 3] = friction.spin[i]
    slides = False
    for c in range(friction.bearings):
        i = friction.bearing[c]
        slides = slides or friction.length[i] > TINY
        even = even or TINY < friction.length[i] <= floats
    if slides:
        _take_apart(bodies, problem, friction, work)
    if even:
        _spread_evenly(bodies, problem, friction, loaded, work)
    for c in range(friction.bearings):
        i = friction.bearing[c]
        if friction.length[i] <= TINY:
            for j in range(3):
                wanted[i, j] = friction.along[i, 0, j]
            wanted[i, 3] = friction.about[i, 0]
            continue
        give = 0.0
        for j in range(work.part.shape[2]):
            give += work.part[c, 1, j] ** 2
        stiffness = 1.0 / give if give > 0.0 else 1.0
        for j in range(4):
            wanted[i, j] *= stiffness
        if friction.length[i] <= floats:
            _add_evenly(c, i, problem, friction, work)
    for k in range(loaded.count):
        row = loaded.row[k]
        i, kind = problem.owner[row], problem.kind[row]
        if kind == 0 or i < 0 or friction.length[i] <= floats:
            continue
        e = (kind - 1) % DIRECTIONS
        size = loaded.multiplier[k] if kind <= DIRECTIONS else -loaded.multiplier[k]
        for j in range(3):
            wanted[i, j] += size * friction.along[i, e, j]
        wanted[i, 3] += size * friction.about[i, e]


@jit
def turn_contacts(friction: Record, work: Record) -> None:
    """Turn the directions of the contacts that bear a force as they lean."""
    wanted = work.wanted
    for c in range(friction.bearings):
        i = friction.bearing[c]
        if friction.length[i] > TINY:
            orient(friction, i, wanted[i, 0], wanted[i, 1], wanted[i, 2], wanted[i, 3])
