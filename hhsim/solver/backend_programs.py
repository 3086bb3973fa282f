"""Programs of a tick as `QpProblem`s, from the kernels' rows, and ticks whose programs any installed QP solver solves.

Programs are there to inspect, to solve again and to compare. The tick is the kernels' own,
`hhsim.kernels.tick.tick.converge`, run as Python: only the solving differs, and a program that a backend fails on
counts as infeasible.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import IntArray
from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.contact.linearise import LIMIT_ROWS
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL, QpWork
from hhsim.kernels.tick import method as parts
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_tick
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.method import Coupled
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.kernels.tick.step import ACTIVE_CAPACITY, DURATION_PALM
from hhsim.kernels.tick.tick import converge, solve_hand, solve_hand_until_kept, solve_until_kept
from hhsim.solver.qp import QpProblem, QpStatus, solve
from hhsim.solver.workspace import TickWorkspace

MULTIPLIER_FLOOR = 1e-9
"""Interior-point backends leave smaller multipliers [N] on inactive rows."""


class PythonPrograms(NamedTuple):
    """A method whose programs are solved in Python: `solve` writes the state's `step` and returns True if it could."""

    options: TickOptions
    method: Coupled
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


def run_block_with_backend(workspace: TickWorkspace, method: Coupled, haptic: HapticBlock, record: TickRecord) -> int:
    """Run one tick per haptic configuration with the QP solver that the options name; return the ticks done."""
    state, backend = workspace.states[0], workspace.options.qp
    tick = getattr(converge, "py_func", converge)
    given = PythonPrograms(method.options, method, lambda: _solve_with(backend, state))
    for i, sample in enumerate(zip(*haptic)):
        cpu, wall = thread_cpu_ns(), monotonic_ns()
        status = set_haptic(workspace.hand, *sample, state)
        status |= tick(given, workspace.hand, workspace.code, state, workspace.qp)
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


def coupled_problem(state: Any) -> tuple[QpProblem, IntArray]:
    """Return the coupled program of the current linearisation, and the kernels' row of each of its rows.

    `state` is a tick's after `hhsim.kernels.tick.linearisation.build_program` has found contacts. Rows are the palm's
    contacts, each finger's contacts and joint limits, and those of the hand's own parts.
    """
    problem, start, own = state.problem, state.contacts.start, state.self_contact
    limits = start[-1] + np.arange(LIMIT_ROWS).reshape(FINGER_COUNT, -1)
    fingers = [np.append(np.arange(start[f + 1], start[f + 2]), limits[f]) for f in range(FINGER_COUNT)]
    index = np.concatenate([np.arange(start[0], start[1]), *fingers])
    matrix = np.zeros((index.size, DOF))
    matrix[:, :6] = problem.common[:, index].T
    first = start[1] - start[0]
    for f, rows in enumerate(fingers):
        column = 6 + PHALANX_COUNT * f
        matrix[first : first + rows.size, column : column + PHALANX_COUNT] = problem.block[:, rows].T
        first += rows.size
    index = np.append(index, start[-1] + LIMIT_ROWS + np.arange(own.count))
    matrix = np.concatenate([matrix, own.dense[: own.count]])
    weight, stiffness = problem.inverse_root, np.array(state.stiffness)
    return QpProblem(stiffness, matrix / weight, problem.rhs[index], problem.target * weight), index
