"""The tick driven from Python, so that any installed QP backend can solve its programs.

The same kernels detect, build, judge and take steps as in `kernels.tick.tick`; only the solving differs, and a program
that a backend fails on is treated as one without solution. In the progressive method our solver decides which fingers
join the palm's program, since few backends tell infeasible from unsolved.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.clock import monotonic_ns, thread_cpu_ns
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PHALANX_COUNT, HandArrays
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.tick.block import TickRecord, record_tick
from hhsim.kernels.tick.progressive import solve_progressive
from hhsim.kernels.tick.state import METHOD_COUPLED, STATUS_FULL, TickOptions
from hhsim.kernels.tick.step import ACTIVE_CAPACITY, DURATION_FINGERS, DURATION_PALM
from hhsim.kernels.tick.tick import (
    advance,
    begin_tick,
    clip_target,
    finish_tick,
    goes_round,
    prepare,
    recover,
    set_haptic,
    solve_together,
    spent_units,
)
from hhsim.solver.contact_qp import coupled_problem, finger_problem, palm_problem
from hhsim.solver.qp import QpProblem, QpStatus, solve

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MULTIPLIER_FLOOR = 1e-9
"""Multipliers [N] that interior-point backends leave on inactive rows are below this."""


def run_block_with_backend(
    hand: HandArrays,
    tree: TreeArrays,
    options: TickOptions,
    state: Any,
    qp: QpWork,
    backend: str,
    haptic: list[FloatArray],
    record: TickRecord,
) -> int:
    """Run one tick for each haptic configuration with `backend`; as `kernels.block.run_block`."""
    position, orientation, flexion, abduction = haptic

    def solve_program() -> bool:
        if options.method == METHOD_COUPLED or state.together:
            return _solve_coupled(state, backend)
        return _solve_progressive(options, state, qp, backend)

    for i in range(len(position)):
        cpu, wall = thread_cpu_ns(), monotonic_ns()
        status = set_haptic(hand, position[i], orientation[i], flexion[i], abduction[i], state)
        status |= drive_tick(hand, tree, options, state, qp, solve_program)
        wall, cpu = monotonic_ns() - wall, thread_cpu_ns() - cpu
        record_tick(state, status, wall, cpu, i, record)
        if status & STATUS_FULL:
            return i + 1
    return len(position)


def drive_tick(
    hand: HandArrays, tree: TreeArrays, options: TickOptions, state: Any, qp: QpWork, solve_program: Callable[[], bool]
) -> int:
    """One tick after `set_haptic`, as `kernels.tick.tick`, with any way to solve a linearisation's program.

    `solve_program` writes the state's `step` and says whether there is a solution. Returns the tick's status bits.
    """
    begin_tick(options, state)
    status = 0
    for i in range(options.linearisations):
        if i > 0 and spent_units(state) >= options.budget:
            break
        if goes_round(options, state, i):
            solve_together(state)
        contacts = prepare(hand, tree, options, state)
        if contacts < 0:
            status |= STATUS_FULL
            break
        solved = True
        while contacts > 0:
            solved = solve_program()
            if not solved or not clip_target(hand, options, state):
                break
        if not solved:
            if recover(hand, tree, options, state):
                continue
            break
        if advance(hand, tree, options, state):
            break
    return int(status | finish_tick(hand, tree, options, state, qp))


def _solve_coupled(state: Any, backend: str) -> bool:
    began = monotonic_ns()
    problem, rows = coupled_problem(state)
    state.step.count = 0
    solved = _take(state, problem, rows, slice(0, DOF), backend)
    state.step.duration[DURATION_PALM] += monotonic_ns() - began
    return solved


def _solve_progressive(options: TickOptions, state: Any, qp: QpWork, backend: str) -> bool:
    status = solve_progressive(
        state.pose,
        state.problem,
        state.contacts,
        state.warm,
        options.tolerance,
        options.relaxation,
        options.longest_correction,
        state.progressive,
        state.correction,
        qp,
        state.crew,
        state.step,
    )
    if status != OPTIMAL:
        return False
    began = monotonic_ns()
    problem, rows = palm_problem(state)
    state.step.count = 0
    solved = _take(state, problem, rows, slice(0, 6), backend)
    state.step.duration[DURATION_PALM] += monotonic_ns() - began
    began = monotonic_ns()
    for finger in range(FINGER_COUNT):
        if not solved:
            break
        if state.contacts.start[finger + 1] == state.contacts.start[finger + 2]:
            continue
        problem, rows = finger_problem(state, finger, state.step.delta[:6])
        first = 6 + PHALANX_COUNT * finger
        solved = _take(state, problem, rows, slice(first, first + PHALANX_COUNT), backend)
    state.step.duration[DURATION_FINGERS] += monotonic_ns() - began
    return solved


def _take(state: Any, problem: QpProblem, rows: IntArray, part: slice, backend: str) -> bool:
    """Solve and append the solution's leading variables and its multipliers to the tick's step."""
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
