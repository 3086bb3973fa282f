"""Method `progressive`: the paper's decoupled-and-progressive framework, palm first, then finger by finger.

The paper's palm problem does not see the fingers and can carry one to where its three joint angles cannot free it. Here the palm yields
to that: when the rows A_θ δθ >= b - A_p δp of a finger contradict each other for the palm step δp, the solver returns Farkas
multipliers y >= 0 with yᵀ A_θ = 0, so that every palm step that leaves the finger a way out satisfies yᵀ A_p δp >= yᵀ b. That is one
more row of the palm problem, a feasibility cut (Benders 1962); the palm is solved again. Standing still satisfies every cut,
there are finitely many, so the loop ends with a palm step that all five fingers can follow: the guarantee
of `coupled`, with the paper's order of precedence.
"""

import numpy as np
from numpy.typing import NDArray

from .active_set import INFEASIBLE, ITERATION_LIMIT, OPTIMAL, QpWork, solve
from .clock import monotonic_ns
from .hand import DOF, FINGER_COUNT, PHALANX_COUNT
from .jit import jit
from .linearise import CUT_ROWS, ROW_CAPACITY, limit_start
from .second_order import correct_for_curvature
from .step import ACTIVE_CAPACITY, DURATION_FINGERS, DURATION_PALM, guess_rows

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


CUT_SIZE = PHALANX_COUNT + 2
"""Most rows that a cut can combine: one more than are independent, and one to spare."""

PROGRESSIVE_WORK = np.dtype(
    [
        ("palm_start", np.int64, (2,)),
        ("palm_stop", np.int64, (2,)),
        ("palm_block", np.int64, (2,)),
        ("finger_start", np.int64, (2,)),
        ("finger_stop", np.int64, (2,)),
        ("finger_block", np.int64, (2,)),
        ("guess", np.int64, (ACTIVE_CAPACITY,)),
        ("palm_active", np.int64, (6,)),
        ("palm_step", np.float64, (6,)),
        ("target", np.float64, (PHALANX_COUNT,)),
        ("rhs", np.float64, (ROW_CAPACITY,)),
        ("cut_row", np.int64, (CUT_ROWS, CUT_SIZE)),
        ("cut_weight", np.float64, (CUT_ROWS, CUT_SIZE)),
        ("cut_size", np.int64, (CUT_ROWS,)),
    ],
    align=True,
)
"""Row groups of the palm's program (contacts, cuts) and of a finger's (contacts, limits), guesses, the palm's step and active rows,
the finger rows' right-hand sides for that step, and the rows and weights of which each cut is made."""


@jit
def finger_rhs(problem: np.record, start: int, stop: int, palm_step: Array, rhs_out: Array) -> None:
    """Right-hand sides of rows [start, stop) once the palm has taken its (scaled) step, shape (6,)."""
    for i in range(start, stop):
        total = problem.rhs[i]
        for j in range(6):
            total -= problem.common[j, i] * palm_step[j]
        rhs_out[i] = total


@jit
def _add_cut(problem: np.record, row: int, work: np.record, cut: int, finger: QpWork) -> None:
    count = finger.counts[0]
    size = 0
    for i in range(-1, count):
        source = finger.counts[2] if i < 0 else finger.active[i]
        weight = finger.inverse_norm[source]
        if i >= 0:
            weight *= max(-finger.dual_step[i], 0.0)
        elif weight == 0.0:
            weight = 1.0
        work.cut_row[cut, size] = source
        work.cut_weight[cut, size] = weight
        size += 1
    work.cut_size[cut] = size
    for j in range(6):
        problem.common[j, row] = 0.0
    for j in range(PHALANX_COUNT):
        problem.block[j, row] = 0.0
    problem.rhs[row] = 0.0
    for i in range(size):
        source, weight = work.cut_row[cut, i], work.cut_weight[cut, i]
        for j in range(6):
            problem.common[j, row] += weight * problem.common[j, source]
        problem.rhs[row] += weight * problem.rhs[source]


@jit
def solve_progressive(
    pose: np.record,
    problem: np.record,
    contacts: np.record,
    active: np.record,
    tolerance: float,
    relaxation: float,
    longest: float,
    work: np.record,
    correction: np.record,
    qp: QpWork,
    step: np.record,
) -> int:
    """Solve palm, then fingers, the palm yielding where it must; `step` is written where the status is OPTIMAL."""
    first_cut = limit_start(contacts, np.int64(FINGER_COUNT))
    work.palm_start[0] = contacts.start[0]
    work.palm_stop[0] = contacts.start[1]
    work.palm_block[0] = -1
    work.palm_start[1] = first_cut
    work.palm_stop[1] = first_cut
    work.palm_block[1] = -1
    cuts = np.int64(0)
    guessed = guess_rows(contacts, active, np.int64(0), work.guess[:], np.int64(0))
    while True:
        began = monotonic_ns()
        status = solve(
            np.int64(6),
            np.int64(6),
            problem.common[:],
            problem.block[:],
            problem.rhs[:],
            work.palm_start[:],
            work.palm_stop[:],
            work.palm_block[:],
            problem.target[:],
            tolerance,
            relaxation,
            work.guess[:],
            guessed,
            qp,
        )
        step.iterations += qp.counts[1]
        solved = monotonic_ns()
        step.duration[DURATION_PALM] += solved - began
        if status != OPTIMAL:
            return status
        count = qp.counts[0]
        palm_active = count
        for i in range(count):
            work.palm_active[i] = qp.active[i]
            step.row[i] = qp.active[i]
            step.multiplier[i] = qp.multiplier[i]
        for j in range(DOF):
            step.delta[j] = qp.x[j] * problem.inverse_root[j] if j < 6 else 0.0
        correct_for_curvature(
            pose,
            contacts,
            problem.inverse_root[:],
            step.row[:],
            step.multiplier[:],
            np.int64(0),
            count,
            step.delta[:],
            np.int64(0),
            np.int64(6),
            np.int64(6),
            problem.common[:],
            problem.block[:],
            problem.rhs[:],
            work.palm_start[:],
            work.palm_stop[:],
            work.palm_block[:],
            tolerance,
            longest,
            correction,
            qp,
        )
        for j in range(6):
            work.palm_step[j] = qp.x[j]
            step.delta[j] = qp.x[j] * problem.inverse_root[j]
        yielding = False
        for f in range(FINGER_COUNT):
            work.finger_start[0] = contacts.start[f + 1]
            work.finger_stop[0] = contacts.start[f + 2]
            if work.finger_start[0] == work.finger_stop[0]:
                # Nothing but its limits binds it, and to those its target has been clamped, see `kernels.tick.prepare`.
                for j in range(6 + 3 * f, 9 + 3 * f):
                    step.delta[j] = problem.target[j] * problem.inverse_root[j]
                continue
            work.finger_start[1] = limit_start(contacts, f)
            work.finger_stop[1] = limit_start(contacts, f + 1)
            finger_rhs(problem, work.finger_start[0], work.finger_stop[0], work.palm_step, work.rhs)
            finger_rhs(problem, work.finger_start[1], work.finger_stop[1], work.palm_step, work.rhs)
            for k in range(PHALANX_COUNT):
                work.target[k] = problem.target[6 + 3 * f + k]
            guessed = guess_rows(contacts, active, f + 1, work.guess[:], np.int64(0))
            status = solve(
                np.int64(PHALANX_COUNT),
                np.int64(0),
                problem.common[:],
                problem.block[:],
                work.rhs[:],
                work.finger_start[:],
                work.finger_stop[:],
                work.finger_block[:],
                work.target[:],
                tolerance,
                relaxation,
                work.guess[:],
                guessed,
                qp,
            )
            step.iterations += qp.counts[1]
            if status == INFEASIBLE:
                if cuts == CUT_ROWS:
                    return ITERATION_LIMIT
                _add_cut(problem, first_cut + cuts, work, cuts, qp)
                cuts += 1
                yielding = True
                continue
            if status != OPTIMAL:
                return status
            if yielding:
                continue
            before = count
            for i in range(qp.counts[0]):
                step.row[count] = qp.active[i]
                step.multiplier[count] = qp.multiplier[i]
                count += 1
            for k in range(PHALANX_COUNT):
                step.delta[6 + 3 * f + k] = qp.x[k] * problem.inverse_root[6 + 3 * f + k]
            correct_for_curvature(
                pose,
                contacts,
                problem.inverse_root[:],
                step.row[:],
                step.multiplier[:],
                before,
                count,
                step.delta[:],
                np.int64(6 + 3 * f),
                np.int64(PHALANX_COUNT),
                np.int64(0),
                problem.common[:],
                problem.block[:],
                work.rhs[:],
                work.finger_start[:],
                work.finger_stop[:],
                work.finger_block[:],
                tolerance,
                longest,
                correction,
                qp,
            )
            for k in range(PHALANX_COUNT):
                step.delta[6 + 3 * f + k] = qp.x[k] * problem.inverse_root[6 + 3 * f + k]
        step.duration[DURATION_FINGERS] += monotonic_ns() - solved
        if not yielding:
            break
        work.palm_stop[1] = first_cut + cuts
        guessed = palm_active
        for i in range(guessed):
            work.guess[i] = work.palm_active[i]
    # A cut stands for the finger contacts of which it is made: they carry its force.
    for i in range(palm_active):
        row = step.row[i]
        if row < first_cut:
            continue
        cut, multiplier = row - first_cut, step.multiplier[i]
        step.row[i] = work.cut_row[cut, 0]
        step.multiplier[i] = multiplier * work.cut_weight[cut, 0]
        for j in range(1, work.cut_size[cut]):
            step.row[count] = work.cut_row[cut, j]
            step.multiplier[count] = multiplier * work.cut_weight[cut, j]
            count += 1
    step.count = count
    return OPTIMAL
