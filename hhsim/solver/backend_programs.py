"""Programs of `coupled`'s ticks solved by any installed QP solver.

The tick is the kernels' own, `hhsim.kernels.tick.tick.converge`, run as Python: only the solving differs, and a program
that a backend fails on counts as infeasible.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.qp.active_set import INFEASIBLE, OPTIMAL, QpWork
from hhsim.kernels.tick import method as parts
from hhsim.kernels.tick.block import HapticBlock, TickRecord, record_tick
from hhsim.kernels.tick.haptic_input import set_haptic
from hhsim.kernels.tick.method import Coupled, Progressive
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.state import STATUS_CAPACITY_EXCEEDED
from hhsim.kernels.tick.step import ACTIVE_CAPACITY, DURATION_PALM
from hhsim.kernels.tick.tick import converge, solve_hand
from hhsim.solver.contact_qp import coupled_problem
from hhsim.solver.qp import QpStatus, solve
from hhsim.solver.workspace import TickWorkspace

MULTIPLIER_FLOOR = 1e-9
"""Interior-point backends leave smaller multipliers [N] on inactive rows."""


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
parts.solve_linearisation.of(PythonPrograms)(getattr(solve_hand, "py_func", solve_hand))


def drive_tick(workspace: TickWorkspace, method: Coupled | Progressive, solve: Callable[[], bool]) -> int:
    """Run one tick after `set_haptic` with any solver of a linearisation's program; return the tick's status bits."""
    tick = getattr(converge, "py_func", converge)
    given = PythonPrograms(method.options, method, solve)
    return int(tick(given, workspace.hand, workspace.surface, workspace.states[0], workspace.qp))


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
