"""Programs of a tick as `QpProblem`s, from the kernels' rows, and ticks whose programs any installed QP solver solves.

Programs are there to inspect, to solve again and to compare. The tick is the kernels' own,
`hhsim.kernels.tick.tick.converge`, run as Python: only the solving differs, and a program that a backend fails on
counts as infeasible.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.contact.linearise import LIMIT_ROWS
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL, QpWork
from hhsim.kernels.tick import method as parts
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_tick
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.method import Coupled, Progressive
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.progressive import YIELD_SCALE
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.kernels.tick.step import ACTIVE_CAPACITY, DURATION_PALM
from hhsim.kernels.tick.tick import converge, solve_hand, solve_hand_until_kept, solve_until_kept
from hhsim.reproducible import matmul
from hhsim.solver.qp import QpProblem, QpStatus, solve
from hhsim.solver.workspace import TickWorkspace

MULTIPLIER_FLOOR = 1e-9
"""Interior-point backends leave smaller multipliers [N] on inactive rows."""
LIMITS_PER_FINGER = LIMIT_ROWS // FINGER_COUNT


class PythonPrograms(NamedTuple):
    """A method whose programs are solved in Python: `solve` writes the state's `step` and returns True if it could."""

    options: TickOptions
    method: Coupled | Progressive
    solve: Callable[[], bool]


@parts.solve_program.of(PythonPrograms)
def _solve(given: PythonPrograms, state: Any, qp: QpWork) -> int:
    return OPTIMAL if given.solve() else INFEASIBLE


def _as_the_method(part: Any) -> Any:
    return lambda given, *others: part(given.method, *others)


for _part in (parts.begin_motion, parts.may_end, parts.recover, parts.advance, parts.finish_tick, parts.energy_stalled):
    _part.of(PythonPrograms)(_as_the_method(_part))
# Interpreted, so that it can call Python; what else it calls is compiled.
for _generic, _kernel in ((parts.solve_linearisation, solve_hand), (solve_until_kept, solve_hand_until_kept)):
    _generic.of(PythonPrograms)(getattr(_kernel, "py_func", _kernel))


def drive_tick(workspace: TickWorkspace, method: Coupled | Progressive, solve: Callable[[], bool]) -> int:
    """Run one tick after `set_haptic` with any solver of a linearisation's program; return the tick's status bits."""
    tick = getattr(converge, "py_func", converge)
    given = PythonPrograms(method.options, method, solve)
    return int(tick(given, workspace.hand, workspace.code, workspace.states[0], workspace.qp))


def run_block_with_backend(workspace: TickWorkspace, method: Coupled, haptic: HapticBlock, record: TickRecord) -> int:
    """Run one tick per haptic configuration with the QP solver that the options name; return the ticks done."""
    state, backend = workspace.states[0], workspace.options.qp
    for i, sample in enumerate(zip(*haptic)):
        cpu, wall = thread_cpu_ns(), monotonic_ns()
        status = set_haptic(workspace.hand, *sample, state)
        status |= drive_tick(workspace, method, lambda: _solve_with(backend, state))
        wall, cpu = monotonic_ns() - wall, thread_cpu_ns() - cpu
        record_tick(state, status, wall, cpu, i, record)
        if status & STATUS_CAPACITY_EXCEEDED:
            return i + 1
    return len(haptic.position)


def _solve_with(backend: str, state: Any) -> bool:
    began, step = monotonic_ns(), state.step
    problem, rows = coupled_problem(state)
    solution = solve(problem, backend)
    solved = solution.status in (QpStatus.OPTIMAL, QpStatus.INACCURATE)
    step.count = 0
    if solved:
        step.delta[:] = solution.x
        pushing = np.flatnonzero(solution.multiplier > MULTIPLIER_FLOOR)[:ACTIVE_CAPACITY]
        step.count = len(pushing)
        step.row[: step.count], step.multiplier[: step.count] = rows[pushing], solution.multiplier[pushing]
    step.duration[DURATION_PALM] += monotonic_ns() - began
    return solved


def finger_rows(state: Any, finger: int) -> IntArray:
    """Return the rows of one finger: its contacts, then its six joint limits."""
    start = state.contacts.start
    limits = start[-1] + LIMITS_PER_FINGER * finger
    return np.concatenate(
        [np.arange(start[finger + 1], start[finger + 2]), np.arange(limits, limits + LIMITS_PER_FINGER)]
    )


def coupled_problem(state: Any) -> tuple[QpProblem, IntArray]:
    """Return the coupled program of the current linearisation, and the kernels' row of each of its rows.

    `state` is a tick's after `hhsim.kernels.tick.linearisation.build_program` has found contacts.
    """
    problem, start = state.problem, state.contacts.start
    rows = [np.arange(start[0], start[1]), *(finger_rows(state, finger) for finger in range(FINGER_COUNT))]
    firsts = [-1, *range(6, DOF, PHALANX_COUNT)]
    index, matrix = _stacked(rows, firsts, DOF, problem.common, problem.block)
    own = state.self_contact
    index = np.append(index, start[-1] + LIMIT_ROWS + np.arange(own.count))
    matrix = np.concatenate([matrix, own.dense[: own.count]])
    return _unscaled(state, matrix, problem.rhs[index], problem.target, slice(0, DOF)), index


def _stacked(
    rows: list[IntArray], firsts: list[int], width: int, common: FloatArray, block: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Rows of groups as one index, and their matrix; a group's block begins at its first column, if that is not -1."""
    index = np.concatenate(rows)
    matrix = np.zeros((index.size, width))
    matrix[:, :6] = common[:, index].T
    stop = 0
    for own, first in zip(rows, firsts):
        begin, stop = stop, stop + own.size
        if first >= 0:
            matrix[begin:stop, first : first + PHALANX_COUNT] = block[:, own].T
    return index, matrix


def palm_problem(state: Any) -> tuple[QpProblem, IntArray]:
    """Return the palm's program of `progressive`, and the kernels' row of each of its rows.

    Variables are the palm's six and three for each finger that joined it, which keeps `YIELD_WEIGHT` of its stiffness.
    """
    problem, work = state.problem, state.progressive
    count = int(work.variables)
    weight = np.concatenate([problem.inverse_root[:6], np.zeros(count - 6)])
    for finger, first in enumerate(work.yields.tolist()):
        if first >= 0:
            own = 6 + PHALANX_COUNT * finger
            weight[first : first + PHALANX_COUNT] = YIELD_SCALE * problem.inverse_root[own : own + PHALANX_COUNT]
    rows = [np.arange(start, stop) for start, stop in zip(work.palm_start, work.palm_stop)]
    index, matrix = _stacked(rows, work.palm_block.tolist(), count, problem.common, work.block)
    target = work.palm_target[:count] * weight
    return QpProblem(1.0 / (weight * weight), matrix / weight, np.array(problem.rhs[index]), target), index


def finger_problem(state: Any, finger: int, palm_step: FloatArray) -> tuple[QpProblem, IntArray]:
    """Return a finger's program after the palm's step (6,) [m, rad], and the kernels' row of each of its rows."""
    problem = state.problem
    index = finger_rows(state, finger)
    first = 6 + PHALANX_COUNT * finger
    part = slice(first, first + PHALANX_COUNT)
    rhs = problem.rhs[index] - matmul(problem.common[:, index].T, palm_step / problem.inverse_root[:6])
    return _unscaled(state, problem.block[:, index].T, rhs, problem.target[part], part), index


def _unscaled(state: Any, matrix: FloatArray, rhs: FloatArray, target: FloatArray, part: slice) -> QpProblem:
    weight = state.problem.inverse_root[part]
    return QpProblem(
        stiffness=np.array(state.stiffness[part]), matrix=matrix / weight, rhs=np.array(rhs), target=target * weight
    )
