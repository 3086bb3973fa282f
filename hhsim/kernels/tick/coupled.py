"""Method `coupled`: all 21 degrees of freedom in one quadratic program.

The paper rejected it as slower than 20 Hz; with a warm-started dual active set it costs what the decoupled one costs,
and since standing still is always feasible, so is the program.
"""

import numpy as np

from hhsim.kernels.clock import monotonic_ns
from hhsim.kernels.contact.linearise import limit_start
from hhsim.kernels.contact.self_pairs import SELF_ROWS
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT
from hhsim.kernels.jit import Indices, Record, as_int64, jit, jit_inline, jit_noinline
from hhsim.kernels.machine_code import call_code
from hhsim.kernels.qp.active_set import OPTIMAL, QpWork, solve
from hhsim.kernels.qp.row_scan import MeetingRows, ProgramRows
from hhsim.kernels.tick.method import Coupled, energy_stalled, solve_program
from hhsim.kernels.tick.options import TickOptions
from hhsim.kernels.tick.second_order import correct_for_curvature, lagrangian_of
from hhsim.kernels.tick.step import ACTIVE_CAPACITY, DURATION_PALM, guess_rows, take_multipliers

GROUPS = 2 * FINGER_COUNT + 1
COUPLED_WORK = np.dtype(
    [
        ("group_start", np.int64, (GROUPS + SELF_ROWS,)),
        ("group_stop", np.int64, (GROUPS + SELF_ROWS,)),
        ("group_block", np.int64, (GROUPS + SELF_ROWS,)),
        ("guess", np.int64, (ACTIVE_CAPACITY,)),
    ],
    align=True,
)
"""Groups of the coupled program (palm, 5 fingers, 5 limit groups, rows of own parts) and the guessed rows."""


@jit
def coupled_groups(contacts: Record, group_start: Indices, group_stop: Indices, group_block: Indices) -> None:
    """Row groups of the program, shapes (>= 11,): palm contacts, then contacts and then joint limits of each finger."""
    for g in range(FINGER_COUNT + 1):
        group_start[g] = contacts.start[g]
        group_stop[g] = contacts.start[g + 1]
        group_block[g] = 6 + 3 * (g - 1) if g > 0 else -1
    for f in range(FINGER_COUNT):
        # Without a contact a finger's limits bind it alone: its target is clamped, see `kernels.tick.linearisation`.
        touched = contacts.start[f + 2] > contacts.start[f + 1]
        group_start[6 + f] = limit_start(contacts, f)
        group_stop[6 + f] = limit_start(contacts, f + 1 if touched else f)
        group_block[6 + f] = 6 + 3 * f


@jit_inline
def _solve_rows(
    options: TickOptions, rows: ProgramRows | MeetingRows, guess: Indices, guessed: int, state: Record, qp: QpWork
) -> int:
    problem, step, tolerance = state.problem, state.step, options.tolerance
    status = solve(as_int64(DOF), rows, problem.target[:], tolerance, options.relaxation, guess, guessed, qp)
    step.iterations += qp.counts[1]
    if status != OPTIMAL:
        return status
    take_multipliers(qp, step)
    for j in range(DOF):
        step.delta[j] = qp.x[j] * problem.inverse_root[j]
    lagrangian = lagrangian_of(options.own, state, step, as_int64(0), as_int64(DOF))
    longest = options.longest_correction
    correct_for_curvature(lagrangian, qp.counts[0], step.delta[:], rows, tolerance, longest, state.correction, qp)
    for j in range(DOF):
        step.delta[j] = qp.x[j] * problem.inverse_root[j]
    return status


@jit_inline
def _solve_contacts(options: TickOptions, guessed: int, state: Record, qp: QpWork) -> int:
    """Solve the program of contacts and joint limits."""
    problem, work = state.problem, state.coupled
    start, stop, block = work.group_start[:GROUPS], work.group_stop[:GROUPS], work.group_block[:GROUPS]
    rows = ProgramRows(as_int64(6), problem.common[:], problem.block[:], problem.rhs[:], start, stop, block)
    return _solve_rows(options, rows, work.guess[:], guessed, state, qp)


@jit
def solve_own(options: TickOptions, guessed: int, state: Record, qp: QpWork) -> int:
    """Solve the program of contacts, joint limits and the hand's own parts."""
    problem, work, parts = state.problem, state.coupled, state.self_contact
    first, end = limit_start(state.contacts, as_int64(FINGER_COUNT)), GROUPS + parts.count
    for f in range(FINGER_COUNT):
        if parts.meets[f] == 1:
            work.group_stop[FINGER_COUNT + 1 + f] = limit_start(state.contacts, f + 1)
    guessed = min(guessed, ACTIVE_CAPACITY - parts.count)
    for i in range(parts.count):
        work.guess[guessed + i] = first + i
        work.group_start[GROUPS + i], work.group_stop[GROUPS + i] = first + i, first + i + 1
    start, stop, block = work.group_start[:end], work.group_stop[:end], work.group_block[:end]
    common, own_columns, rhs = problem.common[:], problem.block[:], problem.rhs[:]
    rows = MeetingRows(as_int64(6), common, own_columns, rhs, start, stop, block, parts.dense[:], parts.count)
    return _solve_rows(options, rows, work.guess[:], guessed + parts.count, state, qp)


@solve_program.of(Coupled)
@jit_noinline
def solve_coupled(method: Coupled, state: Record, qp: QpWork) -> int:
    """Solve the program; return a status of `kernels.qp.active_set`. The state's `step` is written if it is OPTIMAL."""
    work, guessed = state.coupled, as_int64(0)
    coupled_groups(state.contacts, work.group_start[:], work.group_stop[:], work.group_block[:])
    began = monotonic_ns()
    for group in range(FINGER_COUNT + 1):
        guessed = guess_rows(state.contacts, state.warm, group, work.guess[:], guessed)
    options = method.options
    if options.own.solving == 0:
        status = _solve_contacts(options, guessed, state, qp)
    else:
        status = call_code(options.own.solving, (options, guessed, state, qp))
    state.step.duration[DURATION_PALM] += monotonic_ns() - began
    return status


@energy_stalled.of(Coupled)
@jit_inline
def _energy_stalled(method: Coupled, state: Record) -> bool:
    return False
