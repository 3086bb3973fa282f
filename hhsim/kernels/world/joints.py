"""Rows of the joints of a program, limits of their values and dry friction, and the one variable of a jointed body.

That is δ, its rotation [rad] or translation [m] about or along the axis in a step; its other columns are 0. Dry
friction of at most τ [N·m] or [N] costs τ |δ|. In the quadratic program a slack variable t has that cost: t >= |δ| by
two rows, and its target lies so far below 0 that the gradient there is τ. The program before, or in a tick's first one
the speed so far, foresees t, so that friction is τ to the second order.

Two free bodies on a joint keep all of their variables, and a slack variable for friction is one more. Of the six values
of one body's place beside the other, from where both began, one is free: it has limits and friction. The other five are
kept at 0 to `JOINT_TOLERANCE` by two rows.
"""

import math

import numpy as np

from hhsim.kernels.hand.kinematics import BODY_COUNT, PALM_BODY
from hhsim.kernels.jit import Array, Record, as_bool, as_int64, jit
from hhsim.kernels.rotation import rotation_vector_between, turned
from hhsim.kernels.world.body import HINGE, OBJECT_DOF, along_axis, joint_value
from hhsim.kernels.world.columns import States, common_count, name_row, write_row

SLACK = 4
"""Column of a jointed body's slack variable."""
SLACK_OFFSET = 100.0
"""Distance of its target below 0 [rad] or [m]: the relative error of friction is the change of t over it."""
JOINT_KEYS = -900
"""Keys of the rows go down from here: above those of the table, and below those of the fingers' limits."""
JOINT_ROWS = 4
"""Rows of a joint: lower and upper limit, then friction of either sign."""
PAIR_JOINT_ROWS = 14
"""Rows of a joint of two free bodies: limits of each value, and friction. Keys are apart by so many for each body."""
PAIR_JOINT_KIND = -1
"""Kind of such a row."""
JOINT_TOLERANCE = 2e-7
"""Size that the values of such a joint may have [m, rad]."""
END_TOLERANCE = 1e-6
"""The same at the end of a tick, unless it lags."""


@jit
def slack_column(body: Record, problem: Record, k: int) -> int:
    """Return the slack variable of the joint of body k."""
    return as_int64(problem.width + k if body.pair_joint > 0 else problem.column[k] + SLACK)


@jit
def has_joint_rows(body: Record) -> bool:
    """Return True for a joint with friction or limits, and for one of two free bodies."""
    if body.pair_joint > 0:
        return as_bool(True)
    limited = body.limits[0] > -np.inf or body.limits[1] < np.inf
    return as_bool(body.joint > 0 and (body.joint_friction > 0.0 or limited))


@jit
def pair_values(body: Record, pose: Record, values_out: Array) -> float:
    """Compute the values of a joint of two free bodies, shape (6,), and return by how much they are not kept at most.

    They are the way [m] across the axis and along it, then the tilt [rad] about the axes across and the turn about it.
    `pose` is the body's beside the other one.
    """
    axes, origin, center, scratch = body.joint_axes, body.joint_origin, body.center, body.vector
    x, y, z = turned(pose.rotation, origin[0] - center[0], origin[1] - center[1], origin[2] - center[2])
    x, y, z = x + pose.position[0] - origin[0], y + pose.position[1] - origin[1], z + pose.position[2] - origin[2]
    values_out[0], values_out[1], values_out[2] = turned(axes, x, y, z)
    ux, uy, uz = axes[2, 0], axes[2, 1], axes[2, 2]
    ax, ay, az = turned(pose.rotation, ux, uy, uz)
    tilt = turned(axes, uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax)
    start = body.other
    start[0], start[1], start[2], start[3] = 1.0, 0.0, 0.0, 0.0
    rotation_vector_between(start[:], pose.orientation[:], scratch[:])
    turn = turned(axes, scratch[0], scratch[1], scratch[2])
    values_out[3], values_out[4], values_out[5] = tilt[0], tilt[1], turn[2]
    free = free_value(body)
    largest = max(body.limits[0] - values_out[free], values_out[free] - body.limits[1])
    for i in range(6):
        if i != free:
            largest = max(largest, abs(values_out[i]))
    return largest


@jit
def free_value(body: Record) -> int:
    """Return which of the values of a joint of two free bodies is free."""
    return as_int64(5 if body.pair_joint == HINGE else 2)


@jit
def _change_of(body: Record, value: float) -> float:
    # Change of the free value in the tick, over the half turn at which a hinge's begins again.
    change = value - body.joint_start
    if body.pair_joint == HINGE and abs(change) > math.pi:
        change -= math.copysign(2.0 * math.pi, change)
    return change


@jit
def begin_joints(states: States, world: Record) -> None:
    """Foresee how far joints move in the tick, and keep the values that those of two free bodies begin with."""
    values = world.problem.scratch
    for k in range(world.problem.bodies):
        body = world.bodies[k]
        body.joint_motion = body.period * (body.spin[2] if body.joint == HINGE else along_axis(body, body.velocity))
        if body.pair_joint > 0:
            pair_values(body, states[body.pair].pose, values[:])
            value = values[free_value(body)]
            body.joint_motion = _change_of(body, value)
            body.joint_start = value


@jit
def _pair_rows(states: States, world: Record, k: int, relaxed: bool, row: int) -> int:
    body, problem = world.bodies[k], world.problem
    pose, axes, values, center = states[body.pair].pose, body.joint_axes, problem.scratch, body.vector
    pair_values(body, pose, values[:])
    contact_code, origin, free = BODY_COUNT * body.pair + PALM_BODY, body.joint_origin, free_value(body)
    center[0], center[1], center[2] = origin[0], origin[1], origin[2]
    for r in range(PAIR_JOINT_ROWS):
        i, sign = r // 2, 1.0 if r % 2 == 0 else -1.0
        of_friction = i == OBJECT_DOF
        if of_friction:
            i = free
        limit = body.limits[r % 2] if i == free else -sign * JOINT_TOLERANCE
        if (of_friction and body.joint_friction == 0.0) or (not of_friction and math.isinf(limit)):
            continue
        along = 1.0 if i < 3 else 0.0
        e = axes[i % 3]
        x, y, z = sign * e[0], sign * e[1], sign * e[2]
        rhs = -sign * _change_of(body, values[i]) if of_friction else sign * (limit - values[i])
        m, w = (along * x, along * y, along * z), ((1.0 - along) * x, (1.0 - along) * y, (1.0 - along) * z)
        write_row(states, world, contact_code, row, center[:], m, w, min(rhs, 0.0) if relaxed else rhs)
        if of_friction:
            problem.common[slack_column(body, problem, k), row] = math.sqrt(SLACK_OFFSET / body.joint_friction)
            problem.rhs[row] = rhs
        row = name_row(problem, row, JOINT_KEYS - PAIR_JOINT_ROWS * k - r, as_int64(-1), as_int64(PAIR_JOINT_KIND))
    return as_int64(row)


@jit
def joints_hold(states: States, world: Record) -> bool:
    """Return whether all values that joints of two free bodies keep are as small as at the end of a tick."""
    values = world.problem.scratch
    for k in range(world.problem.bodies):
        body = world.bodies[k]
        if body.pair_joint > 0 and not pair_values(body, states[body.pair].pose, values[:]) <= END_TOLERANCE:
            return as_bool(False)
    return as_bool(True)


@jit
def joint_rows(states: States, world: Record, relaxed: bool, row: int) -> int:
    """Write the rows of all joints from a row on, and return the one behind them."""
    problem = world.problem
    for k in range(problem.bodies):
        body, column = world.bodies[k], problem.column[k]
        if body.pair_joint > 0:
            row = _pair_rows(states, world, as_int64(k), relaxed, row)
        if body.joint == 0 or not has_joint_rows(body):
            continue
        value, moved = joint_value(body), along_axis(body, problem.total[column : column + OBJECT_DOF])
        own = column + (5 if body.joint == HINGE else 0)
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
                problem.common[slack_column(body, problem, k), row] = math.sqrt(SLACK_OFFSET / body.joint_friction)
                problem.rhs[row] = -sign * moved
            else:
                problem.rhs[row] = sign * (limit - value)
            row = name_row(problem, row, JOINT_KEYS - PAIR_JOINT_ROWS * k - r, as_int64(-1), as_int64(0))
    return as_int64(row)
