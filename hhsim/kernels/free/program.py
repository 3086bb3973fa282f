"""The program of hand and free object, solved until friction opposes the slip that comes out of it."""

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.free.body import as_object_moves
from hhsim.kernels.free.coulomb import begin_sweeps, sweep, take_solution
from hhsim.kernels.free.rows import (
    COMMON,
    DIRECTIONS,
    FREE_DOF,
    ON_TABLE,
    TABLE_KEYS,
    TINY,
    contact_rows,
    friction_rows,
    measure_slip,
)
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT
from hhsim.kernels.jit import Record, as_int64, jit, jit_once
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork, solve
from hhsim.kernels.qp.row_scan import ProgramRows
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.step import ACTIVE_CAPACITY

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ROUNDS = 8
LATER_ROUNDS = 4
"""Most solutions of a program with one Γ after another: of a tick's first program, and of the others."""
SETTLED = 0.2
SETTLED_SHARE = 1e-3
"""A Γ that is off by no more than this share of the clearance and this one of it is left: so far a contact floats."""
ASTRAY = 2e-4
"""An e_1 is turned to the slip where one minus the cosine of the angle between them is more than this."""
NO_LOAD = 1e-3
"""A contact whose normal row bears no more than this share of its load rubs with all of it."""
AT_REST = 1e-11
"""An object that would move by no more than this in a tick [m], and touches something, does not: it is the tolerance of
a program, and what moves so slowly would go on for ever."""

LOADED = np.dtype(
    [
        ("count", np.int64),
        ("key", np.int64, (ACTIVE_CAPACITY,)),
        ("row", np.int64, (ACTIVE_CAPACITY,)),
        ("multiplier", np.float64, (ACTIVE_CAPACITY,)),
        ("guess", np.int64, (ACTIVE_CAPACITY,)),
    ],
    align=True,
)
"""Rows with a multiplier at the last solution: keys, rows, multipliers; and the guess made of them."""


@jit_once
def _guess(problem: Record, loaded: Record) -> int:
    # The rows whose keys carried a multiplier the last time.
    start, stop = problem.group_start, problem.group_stop
    key, wanted = problem.key, loaded.key
    filled = as_int64(0)
    for i in range(loaded.count):
        found = False
        for g in range(start.shape[0]):
            if found or start[g] == stop[g]:
                continue
            for row in range(start[g], stop[g]):
                if key[row] == wanted[i]:
                    loaded.guess[filled] = row
                    filled += 1
                    found = True
                    break
    return filled


@jit
def scale_target(body: Record, problem: Record) -> None:
    """The program's target, scaled and in its order."""
    hand, target, weight = problem.hand_target, problem.target, problem.inverse_root
    for j in range(6):
        target[j] = hand[j] / weight[j]
        target[6 + j] = problem.body_target[j] / body.inverse_root[j]
    for j in range(6, DOF):
        target[6 + j] = hand[j] / weight[j]


@jit
def take_step(pose: Record, body: Record, problem: Record, step_out: Array) -> None:
    """The hand's step as the object sees it, shape (21,), of the program's."""
    delta = problem.delta
    as_object_moves(body, pose.position[:], delta[0:6], delta[6:12], step_out[0:6])
    for j in range(6, DOF):
        step_out[j] = delta[6 + j]


@jit
def _read(body: Record, problem: Record, friction: Record, loaded: Record, qp: QpWork) -> None:
    # The solution: the step, the loaded rows, and what each contact with friction bears and slips.
    delta, weight = problem.delta, problem.inverse_root
    for j in range(6):
        delta[j] = qp.x[j] * weight[j]
        delta[6 + j] = qp.x[6 + j] * body.inverse_root[j]
    for j in range(6, DOF):
        delta[6 + j] = qp.x[6 + j] * weight[j]
    for i in range(friction.count):
        friction.plain[i] = friction.cone[i] = 0.0
    loaded.count = qp.counts[0]
    for j in range(loaded.count):
        row = qp.active[j]
        multiplier = qp.multiplier[j]
        loaded.row[j] = row
        loaded.key[j] = problem.key[row]
        loaded.multiplier[j] = multiplier
        owner = problem.owner[row]
        if owner >= 0:
            kind = problem.kind[row]
            if kind == 0:
                friction.plain[owner] += multiplier
            else:
                friction.cone[owner] += multiplier


@jit_once
def _is_settled(pose: Record, body: Record, offset: float, problem: Record, friction: Record) -> bool:
    # Whether every contact that bears a force has de Saxcé's Γ and rubs against its slip with all of its load.
    settled = True
    problem.astray = 0.0
    for j in range(FREE_DOF):
        problem.whole[j] = problem.total[j] + problem.delta[j]
    for f in range(FINGER_COUNT):
        problem.whole_abduction[f] = problem.abduction_total[f] + problem.abduction_step[f]
    for i in range(friction.count):
        load = friction.plain[i] + friction.cone[i]
        if friction.rubs[i] == 0 or load == 0.0:
            continue
        slip = measure_slip(pose, body, problem.whole[:], problem.whole_abduction[:], friction, i)
        off = abs(slip - friction.shift[i])
        problem.astray = max(problem.astray, off)
        if off > SETTLED * offset + SETTLED_SHARE * slip or friction.plain[i] > NO_LOAD * load:
            settled = False
        elif slip > TINY:
            x, y, z, spin = friction.slip[i, 0], friction.slip[i, 1], friction.slip[i, 2], friction.spin[i]
            t = friction.along[i, 0]
            across = slip - (x * t[0] + y * t[1] + z * t[2] + spin * friction.about[i, 0])
            if across > ASTRAY * slip:
                settled = False
    return settled


@jit
def _rest(body: Record, problem: Record) -> None:
    delta = problem.delta
    size = 0.0
    turn = 0.0
    for j in range(3):
        size += abs(delta[6 + j])
        # The rotation as the way of a point at the radius of gyration.
        turn += abs(delta[9 + j]) * body.inverse_root[0] / body.inverse_root[3 + j]
    if size + turn <= AT_REST:
        for j in range(6, COMMON):
            delta[j] = 0.0


@jit
def solve_free(
    options: TickOptions,
    pose: Record,
    contacts: Record,
    body: Record,
    relaxed: bool,
    problem: Record,
    friction: Record,
    loaded: Record,
    coulomb: Record,
    step: Record,
    qp: QpWork,
    rounds: int,
) -> int:
    """Solve for a step of hand and object, with one Γ after another until friction is Coulomb's.

    The problem's `delta` and the step's are written where the status is OPTIMAL. Returns a status of
    `kernels.qp.active_set`.
    """
    rows = ProgramRows(
        as_int64(COMMON),
        problem.common[:],
        problem.block[:],
        problem.rhs[:],
        problem.group_start[:],
        problem.group_stop[:],
        problem.group_block[:],
    )
    status = OPTIMAL
    friction_rows(pose, body, contacts, options.offset, relaxed, problem, friction)
    guessed = _guess(problem, loaded)
    for i in range(rounds):
        status = solve(
            as_int64(FREE_DOF),
            rows,
            problem.target[:],
            options.tolerance,
            options.relaxation,
            loaded.guess[:],
            guessed,
            qp,
        )
        step.iterations += qp.counts[1]
        if status != OPTIMAL:
            return status
        problem.solutions += 1
        _read(body, problem, friction, loaded, qp)
        if _is_settled(pose, body, options.offset, problem, friction) or i == rounds - 1:
            break
        if i == 0:
            begin_sweeps(pose, body, options.offset, problem, friction, coulomb)
        take_solution(qp.x[:], problem, friction, loaded, coulomb)
        sweep(options.offset, problem, friction, coulomb)
        for j in range(friction.count):
            if friction.rubs[j] == 1:
                contact_rows(pose, body, options.offset, relaxed, j, friction.row[j], problem, friction)
        guessed = loaded.count
        for j in range(guessed):
            loaded.guess[j] = loaded.row[j]
    if loaded.count > 0:
        _rest(body, problem)
    take_step(pose, body, problem, step.delta[:])
    return status


@jit_once
def hold_loads(problem: Record, friction: Record, loaded: Record, held: Record) -> None:
    """Remember what the contacts with friction bear, to begin the next program from."""
    count = as_int64(0)
    for i in range(friction.count):
        load = friction.plain[i] + friction.cone[i]
        if load == 0.0 or friction.rubs[i] == 0:
            continue
        held.key[count] = TABLE_KEYS - friction.key[i] if friction.body[i] == ON_TABLE else friction.key[i]
        held.spin[count] = friction.spin[i]
        held.about[count] = 0.0
        for j in range(3):
            held.along[count, j] = 0.0
            held.slip[count, j] = friction.slip[i, j]
        for k in range(loaded.count):
            row = loaded.row[k]
            kind = problem.kind[row]
            if problem.owner[row] == i and kind > 0:
                e = (kind - 1) % DIRECTIONS
                size = loaded.multiplier[k] if kind <= DIRECTIONS else -loaded.multiplier[k]
                held.about[count] += size * friction.about[i, e]
                for j in range(3):
                    held.along[count, j] += size * friction.along[i, e, j]
        count += 1
    held.count = count
