"""Programs of a tick as `QpProblem`s, from the kernels' rows, and ticks whose programs any installed QP solver solves.

Programs are there to inspect, to solve again and to compare. The tick is the kernels' own: it calls the solver by an
address, as it calls any other part, and a program that a backend fails on counts as infeasible.
"""

import ctypes
from typing import Any

import numpy as np

from hhsim.arrays import IntArray
from hhsim.kernels.hand.kinematics import DOF, PHALANX_COUNT
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL
from hhsim.kernels.tick.step import ACTIVE_CAPACITY
from hhsim.kernels.world.columns import common_count, variable_count
from hhsim.kernels.world.program import take_hand_steps
from hhsim.kernels.world.rows import contact_groups, end_rows
from hhsim.solver.qp import QpProblem, QpStatus, solve

MULTIPLIER_FLOOR = 1e-9
"""Interior-point backends leave smaller multipliers [N] on inactive rows."""
_CALL = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.POINTER(ctypes.c_int64), *[ctypes.c_void_p] * 5)
"""A kernel as numba calls it: where its value goes, where an exception would, and pointers for its arguments."""


def backend_code(method: Any, backend: str) -> tuple[Any, Any]:
    """Return machine code that solves the programs of a hand alone by a QP solver, and what the caller keeps for it."""
    failed: list[BaseException] = []

    def called(value: Any, *_: Any) -> int:
        try:
            value[0] = OPTIMAL if _solve_with(backend, method) else INFEASIBLE
        except BaseException as error:
            failed.append(error)
            value[0] = INFEASIBLE
        return 0

    code = _CALL(called)
    return ctypes.cast(code, ctypes.c_void_p).value, (code, failed)


def _solve_with(backend: str, method: Any) -> bool:
    world = method.world[0]
    problem, loaded = world.problem, world.loaded
    dense, rows = dense_problem(method)
    solution = solve(dense, backend)
    if solution.status not in (QpStatus.OPTIMAL, QpStatus.INACCURATE):
        return False
    problem.delta[:DOF] = solution.x
    pushing = np.flatnonzero(solution.multiplier > MULTIPLIER_FLOOR)[:ACTIVE_CAPACITY]
    loaded.count = len(pushing)
    loaded.row[: len(pushing)], loaded.multiplier[: len(pushing)] = rows[pushing], solution.multiplier[pushing]
    loaded.key[: len(pushing)] = problem.key[rows[pushing]]
    first = problem.own_row[0]
    problem.own_multiplier[0] = 0.0
    for row, force in zip(rows[pushing], solution.multiplier[pushing]):
        if row >= problem.dense_row:
            problem.own_multiplier[0, row - first] = force
    take_hand_steps(method.states, problem)
    return True


def dense_problem(method: Any) -> tuple[QpProblem, IntArray]:
    """Return the program at hand of a hand alone, and the kernels' row of each of its rows.

    Rows are the palm's contacts, each finger's contacts and joint limits, and those of the hand's own parts.
    """
    world, states = method.world[0], method.states
    problem, state = world.problem, states[0]
    row, relaxed = contact_groups(states, problem, world.meeting), bool(state.program.is_relaxed)
    end_rows(states, method.options.offset, relaxed, row, problem, world.meeting)
    names = "group_start", "group_stop", "group_block"
    groups = zip(*(problem[name][: problem.groups] for name in names))
    common, count = common_count(problem), variable_count(problem)
    rows, parts = [np.zeros(0, np.int64)], [np.zeros((0, count))]
    for start, stop, block in groups:
        part = np.zeros((stop - start, count))
        part[:, :common] = problem.common[:common, start:stop].T
        if block >= 0:
            part[:, block : block + PHALANX_COUNT] = problem.block[:, start:stop].T
        elif start >= problem.dense_row:
            part[:, common:] = problem.dense[: stop - start, : count - common]
        rows.append(np.arange(start, stop))
        parts.append(part)
    index, weight, stiffness = np.concatenate(rows), problem.inverse_root, np.array(state.stiffness)
    target = problem.target[:count] * weight
    return QpProblem(stiffness, np.concatenate(parts) / weight, problem.rhs[index], target), index
