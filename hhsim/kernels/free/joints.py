"""Rows of the hinges of a program: limits of their angles, and dry friction.

A hinged body has one variable, its rotation δ in a step [rad]; its other columns are 0. Dry friction of at most τ [N·m]
costs τ |δ|. In the quadratic program a slack variable t has that cost: t >= |δ| by two rows, and its target lies so far
below 0 that the gradient there is τ. The speed so far foresees t, so that friction is τ to the second order.
"""

import math

import numpy as np

from hhsim.kernels.free.body import hinge_angle
from hhsim.kernels.free.columns import common_count, thing_column, thing_count
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_once

SLACK = 4
"""Column of a hinged body's slack variable."""
TURN = 5
"""Column of its rotation."""
FAR = 100.0
"""Distance of the slack variable's target below 0 [rad]: the relative error of friction is the change of t over it."""
HINGE_KEYS = -900
"""Keys of the rows go down from here: above those of the table, and below those of joint limits."""
HINGE_ROWS = 4
"""Rows of a hinge: lower and upper limit, then friction of either sign."""


@jit
def hinge_target(body: Record) -> float:
    """Compute the scaled target of the slack variable."""
    return (abs(body.period * body.spin[2]) / FAR - 1.0) * math.sqrt(FAR * body.hinge_friction)


@jit
def has_hinge_rows(body: Record) -> bool:
    """Return True for a hinge with friction or limits."""
    limited = body.limits[0] > -np.inf or body.limits[1] < np.inf
    return as_bool(body.is_hinged == 1 and (body.hinge_friction > 0.0 or limited))


@jit_once
def hinge_rows(bodies: Record, row: int, problem: Record) -> int:
    """Write the rows of all hinges from a row on, and return the one behind them."""
    for k in range(thing_count(problem)):
        body, column = bodies[k], thing_column(problem, k)
        if not has_hinge_rows(body):
            continue
        angle, made = hinge_angle(body), problem.total[column + TURN]
        for r in range(HINGE_ROWS):
            sign = 1.0 if r % 2 == 0 else -1.0
            of_friction = r >= HINGE_ROWS // 2
            limit = 0.0 if of_friction else body.limits[r]
            if math.isinf(limit) or (of_friction and body.hinge_friction == 0.0):
                continue
            for j in range(common_count(problem)):
                problem.common[j, row] = 0.0
            for j in range(problem.block.shape[0]):
                problem.block[j, row] = 0.0
            problem.common[column + TURN, row] = sign * body.inverse_root[TURN]
            if of_friction:
                problem.common[column + SLACK, row] = math.sqrt(FAR / body.hinge_friction)
                problem.rhs[row] = -sign * made
            else:
                problem.rhs[row] = sign * (limit - angle)
            problem.key[row] = HINGE_KEYS - HINGE_ROWS * k - r
            problem.owner[row] = -1
            problem.kind[row] = 0
            row += 1
    return as_int64(row)
