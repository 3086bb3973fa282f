"""Method `coupled`: all 21 degrees of freedom in one quadratic program.

The paper rejected it as slower than 20 Hz; with a warm-started dual active set it costs what the decoupled one costs, and since
standing still is always feasible, so is the program.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .active_set import OPTIMAL, QpWork, solve
from .clock import monotonic_ns
from .contact import Contacts
from .hand import DOF, FINGER_COUNT
from .jit import jit
from .linearise import Problem, limit_start
from .step import DURATION_PALM, ActiveContacts, Step, guess_rows

Indices = NDArray[np.int64]


class CoupledWork(NamedTuple):
    """Workspace: the QP's, its groups (palm, 5 fingers, 5 limit groups) and the guessed rows."""

    qp: QpWork
    group_start: Indices
    group_stop: Indices
    group_block: Indices
    guess: Indices


@jit
def coupled_groups(contacts: Contacts, group_start: Indices, group_stop: Indices, group_block: Indices) -> None:
    """Row groups of the coupled program: palm contacts, contacts of each finger, joint limits of each finger; shape (11,)."""
    for g in range(FINGER_COUNT + 1):
        group_start[g] = contacts.start[g]
        group_stop[g] = contacts.start[g + 1]
        group_block[g] = 6 + 3 * (g - 1) if g > 0 else -1
    for f in range(FINGER_COUNT):
        group_start[6 + f] = limit_start(contacts, f)
        group_stop[6 + f] = limit_start(contacts, f + 1)
        group_block[6 + f] = 6 + 3 * f


@jit
def solve_coupled(
    problem: Problem,
    contacts: Contacts,
    active: ActiveContacts,
    tolerance: float,
    relaxation: float,
    work: CoupledWork,
    step: Step,
) -> int:
    """Solve the coupled program; `step` is written where the status is OPTIMAL. Returns a status of `kernels.active_set`."""
    coupled_groups(contacts, work.group_start, work.group_stop, work.group_block)
    began = monotonic_ns()
    guessed = 0
    for group in range(FINGER_COUNT + 1):
        guessed = guess_rows(contacts, active, group, work.guess, guessed)
    status = solve(
        DOF,
        6,
        problem.common,
        problem.block,
        problem.rhs,
        work.group_start,
        work.group_stop,
        work.group_block,
        problem.target,
        tolerance,
        relaxation,
        work.guess,
        guessed,
        work.qp,
    )
    step.count[1] += work.qp.count[1]
    step.duration[DURATION_PALM] += monotonic_ns() - began
    if status != OPTIMAL:
        return status
    for j in range(DOF):
        step.delta[j] = work.qp.x[j] * problem.inverse_root[j]
    count = work.qp.count[0]
    for i in range(count):
        step.row[i] = work.qp.active[i]
        step.multiplier[i] = work.qp.multiplier[i]
    step.count[0] = count
    return status
