"""Programs of a tick solved by any installed QP solver.

The tick is the kernels' own, `hhsim.kernels.tick.tick.converge`, run as Python: only the solving differs, and a program
that a backend fails on counts as infeasible. In `progressive` our solver decides which fingers join the palm's program,
since few backends tell infeasible from unsolved.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import IntArray
from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL, QpWork
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_tick
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.method import (
    Coupled,
    Progressive,
    advance,
    begin_motion,
    energy_stalled,
    finish_tick,
    may_end,
    recover,
    solve_linearisation,
    solve_program,
)
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.kernels.tick.step import ACTIVE_CAPACITY, DURATION_FINGERS, DURATION_PALM
from hhsim.kernels.tick.tick import converge, solve_hand
from hhsim.solver.contact_qp import coupled_problem, finger_problem, palm_problem
from hhsim.solver.qp import QpProblem, QpStatus, solve
from hhsim.solver.workspace import TickWorkspace

MULTIPLIER_FLOOR = 1e-9
"""Interior-point backends leave smaller multipliers [N] on inactive rows."""


class PythonPrograms(NamedTuple):
    """A method whose programs are solved in Python: `solve` writes the state's `step` and returns True if it could."""

    options: TickOptions
    method: Coupled | Progressive
    solve: Callable[[], bool]


@solve_program.of(PythonPrograms)
def _solve(given: PythonPrograms, state: Any, qp: QpWork) -> int:
    return OPTIMAL if given.solve() else INFEASIBLE


def _as_the_method(part: Any) -> Any:
    return lambda given, *others: part(given.method, *others)


for _part in (begin_motion, may_end, recover, advance, finish_tick, energy_stalled):
    _part.of(PythonPrograms)(_as_the_method(_part))
# Interpreted, so that it can call Python; what else it calls is compiled.
solve_linearisation.of(PythonPrograms)(getattr(solve_hand, "py_func", solve_hand))


def drive_tick(workspace: TickWorkspace, method: Coupled | Progressive, solve: Callable[[], bool]) -> int:
    """Run one tick after `set_haptic` with any solver of a linearisation's program; return the tick's status bits."""
    tick = getattr(converge, "py_func", converge)
    given = PythonPrograms(method.options, method, solve)
    return int(tick(given, workspace.hand, workspace.surface, workspace.states[0], workspace.qp))


def run_block_with_backend(
    workspace: TickWorkspace, method: Coupled | Progressive, haptic: HapticBlock, record: TickRecord
) -> int:
    """Run one tick per haptic configuration with the QP solver that the options name; return the ticks done."""
    state, backend = workspace.states[0], workspace.options.qp

    def solve_one() -> bool:
        if isinstance(method, Coupled) or state.program.is_coupled:
            return _solve_first(state, coupled_problem(state), slice(0, DOF), backend)
        return _solve_progressive(method, state, workspace.qp, backend)

    for i, sample in enumerate(zip(*haptic)):
        cpu, wall = thread_cpu_ns(), monotonic_ns()
        status = set_haptic(workspace.hand, *sample, state) | drive_tick(workspace, method, solve_one)
        wall, cpu = monotonic_ns() - wall, thread_cpu_ns() - cpu
        record_tick(state, status, wall, cpu, i, record)
        if status & STATUS_CAPACITY_EXCEEDED:
            return i + 1
    return len(haptic.position)


def _solve_first(state: Any, program: tuple[QpProblem, IntArray], part: slice, backend: str) -> bool:
    """Solve the program of the whole hand, or of the palm."""
    began = monotonic_ns()
    state.step.count = 0
    solved = _take(state, *program, part, backend)
    state.step.duration[DURATION_PALM] += monotonic_ns() - began
    return solved


def _solve_progressive(method: Progressive, state: Any, qp: QpWork, backend: str) -> bool:
    from hhsim.kernels.tick.progressive import solve_progressive

    if solve_progressive(method, state, qp) != OPTIMAL:
        return False
    solved = _solve_first(state, palm_problem(state), slice(0, 6), backend)
    began, start = monotonic_ns(), state.contacts.start
    for finger in range(FINGER_COUNT):
        if solved and start[finger + 1] != start[finger + 2]:
            problem, rows = finger_problem(state, finger, state.step.delta[:6])
            first = 6 + PHALANX_COUNT * finger
            solved = _take(state, problem, rows, slice(first, first + PHALANX_COUNT), backend)
    state.step.duration[DURATION_FINGERS] += monotonic_ns() - began
    return solved


def _take(state: Any, problem: QpProblem, rows: IntArray, part: slice, backend: str) -> bool:
    solution = solve(problem, backend)
    if solution.status not in (QpStatus.OPTIMAL, QpStatus.INACCURATE):
        return False
    step = state.step
    step.delta[part] = solution.x[: part.stop - part.start]
    for i in np.flatnonzero(solution.multiplier > MULTIPLIER_FLOOR)[: ACTIVE_CAPACITY - step.count]:
        step.row[step.count] = rows[i]
        step.multiplier[step.count] = solution.multiplier[i]
        step.count += 1
    return True
