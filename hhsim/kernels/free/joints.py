"""Rows of the joints of a program, limits of their values and dry friction, and the one variable of a jointed body.

That is δ, its rotation [rad] or translation [m] about or along the axis in a step; its other columns are 0. Dry
friction of at most τ [N·m] or [N] costs τ |δ|. In the quadratic program a slack variable t has that cost: t >= |δ| by
two rows, and its target lies so far below 0 that the gradient there is τ. The speed so far foresees t, so that friction
is τ to the second order.
"""

import math

import numpy as np

from hhsim.kernels.free.body import HINGE, OBJECT_DOF, along_axis, joint_value
from hhsim.kernels.free.columns import common_count, thing_column, thing_count
from hhsim.kernels.jit import Record, as_bool, as_int64, jit, jit_once

SLACK = 4
"""Column of a jointed body's slack variable."""
FAR = 100.0
"""Distance of its target below 0 [rad] or [m]: the relative error of friction is the change of t over it."""
JOINT_KEYS = -900
"""Keys of the rows go down from here: above those of the table, and below those of the fingers' limits."""
JOINT_ROWS = 4
"""Rows of a joint: lower and upper limit, then friction of either sign."""


@jit
def joint_column(body: Record) -> int:
    """Return which of a jointed body's columns is δ."""
    return as_int64(5 if body.joint == HINGE else 0)


@jit
def slack_target(body: Record) -> float:
    """Compute the scaled target of the slack variable."""
    speed = body.spin[2] if body.joint == HINGE else along_axis(body, body.velocity)
    return (abs(body.period * speed) / FAR - 1.0) * math.sqrt(FAR * body.joint_friction)


@jit
def has_joint_rows(body: Record) -> bool:
    """Return True for a joint with friction or limits."""
    limited = body.limits[0] > -np.inf or body.limits[1] < np.inf
    return as_bool(body.joint > 0 and (body.joint_friction > 0.0 or limited))


@jit_once
def joint_rows(bodies: Record, row: int, problem: Record) -> int:
    """Write the rows of all joints from a row on, and return the one behind them."""
    for k in range(thing_count(problem)):
        body, column = bodies[k], thing_column(problem, k)
        if not has_joint_rows(body):
            continue
        value, made = joint_value(body), along_axis(body, problem.total[column : column + OBJECT_DOF])
        own = column + joint_column(body)
        for r in range(JOINT_ROWS):
            sign = 1.0 if r % 2 == 0 else -1.0
            of_friction = r >= JOINT_ROWS // 2
            limit = 0.0 if of_friction else body.limits[r]
            if math.isinf(limit) or (of_friction and body.joint_friction == 0.0):
                continue
            for j in range(common_count(problem)):
                problem.common[j, row] = 0.0
            for j in range(problem.block.shape[0]):
                problem.block[j, row] = 0.0
            problem.common[own, row] = sign * body.inverse_root[own - column]
            if of_friction:
                problem.common[column + SLACK, row] = math.sqrt(FAR / body.joint_friction)
                problem.rhs[row] = -sign * made
            else:
                problem.rhs[row] = sign * (limit - value)
            problem.key[row] = JOINT_KEYS - JOINT_ROWS * k - r
            problem.owner[row] = -1
            problem.kind[row] = 0
            row += 1
    return as_int64(row)
