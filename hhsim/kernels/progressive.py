"""Method `progressive`: the paper's decoupled-and-progressive framework, palm first, then finger by finger.

The paper's palm problem does not see the fingers and can carry one to where its three joint angles cannot free it. Here
the palm yields to that. A finger whose program contradicts itself for the palm step at hand joins the palm's program:
its contacts and limits become rows, its three joints variables with a `YIELD_WEIGHT` share of their stiffness. So small
a share makes the palm's choice come first, as in the paper (lexicographic as the share goes to 0), and lets it change
continuously where a finger begins to bind it. Then the fingers are solved for the new palm step. Each round adds a
finger, so there are at most six; standing still is feasible in all of them, and so is the outcome: the guarantee of
`coupled` with the paper's precedence.

A finger with hardly any lever can have a way out that is too long to be taken in one step. A tick in which that leaves
no acceptable step goes on with the coupled program, see `kernels.tick`.
"""

import numpy as np
from numpy.typing import NDArray

from .active_set import INFEASIBLE, OPTIMAL, QpWork, solve
from .clock import monotonic_ns
from .hand import DOF, FINGER_COUNT, PHALANX_COUNT
from .jit import Record, as_int64, jit
from .linearise import ROW_CAPACITY, limit_start
from .second_order import correct_for_curvature
from .step import ACTIVE_CAPACITY, DURATION_FINGERS, DURATION_PALM, guess_rows

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

YIELD_WEIGHT = 1e-4
"""Share of its stiffness that a joint keeps in the palm's program."""
YIELD_SCALE = 100.0
"""1 / √YIELD_WEIGHT: what its columns are multiplied by there."""
PALM_GROUPS = 1 + 2 * FINGER_COUNT

PROGRESSIVE_WORK = np.dtype(
    [
        ("palm_start", np.int64, (PALM_GROUPS,)),
        ("palm_stop", np.int64, (PALM_GROUPS,)),
        ("palm_block", np.int64, (PALM_GROUPS,)),
        ("finger_start", np.int64, (2,)),
        ("finger_stop", np.int64, (2,)),
        ("finger_block", np.int64, (2,)),
        ("yields", np.int64, (FINGER_COUNT,)),
        ("variables", np.int64),
        ("guess", np.int64, (ACTIVE_CAPACITY,)),
        ("palm_target", np.float64, (DOF,)),
        ("palm_step", np.float64, (6,)),
        ("target", np.float64, (PHALANX_COUNT,)),
        ("rhs", np.float64, (ROW_CAPACITY,)),
        ("block", np.float64, (3, ROW_CAPACITY)),
    ],
    align=True,
)
"""Workspace.

| field | meaning |
|---|---|
| palm_start, palm_stop, palm_block | row groups of the palm's program: its contacts; contacts, then limits of each
finger that joined it |
| finger_start, finger_stop, finger_block | row groups of a finger's program: contacts, limits |
| yields | -1, or the first variable of the finger in the palm's program |
| variables | of the palm's program |
| guess | rows expected to be active |
| palm_target | √G δ* of the palm's program |
| palm_step | the palm's step, times √G |
| target, rhs | of a finger's program |
| block | joint columns of the fingers in the palm's program |
"""


@jit
def finger_rhs(problem: Record, start: int, stop: int, palm_step: Array, rhs_out: Array) -> None:
    """Right-hand sides of rows [start, stop) once the palm has taken its (scaled) step, shape (6,)."""
    common, rhs = problem.common, problem.rhs
    for i in range(start, stop):
        total = rhs[i]
        for j in range(6):
            total -= common[j, i] * palm_step[j]
        rhs_out[i] = total


@jit
def _join(problem: Record, contacts: Record, finger: int, work: Record) -> None:
    # The finger's rows and joints become the palm program's.
    first = work.variables
    work.yields[finger] = first
    work.variables += PHALANX_COUNT
    for k in range(PHALANX_COUNT):
        work.palm_target[first + k] = problem.target[6 + PHALANX_COUNT * finger + k] / YIELD_SCALE
    for part in range(2):
        start = contacts.start[finger + 1] if part == 0 else limit_start(contacts, finger)
        stop = contacts.start[finger + 2] if part == 0 else limit_start(contacts, finger + 1)
        group = 1 + 2 * finger + part
        work.palm_start[group] = start
        work.palm_stop[group] = stop
        work.palm_block[group] = first
        for k in range(PHALANX_COUNT):
            for i in range(start, stop):
                work.block[k, i] = YIELD_SCALE * problem.block[k, i]


@jit
def _solve_palm(
    pose: Record,
    problem: Record,
    contacts: Record,
    active: Record,
    tolerance: float,
    relaxation: float,
    longest: float,
    work: Record,
    correction: Record,
    qp: QpWork,
    step: Record,
) -> int:
    step.count = 0
    for j in range(DOF):
        step.delta[j] = 0.0
    if contacts.start[1] == 0 and work.variables == 6:
        for j in range(6):
            work.palm_step[j] = problem.target[j]
            step.delta[j] = problem.target[j] * problem.inverse_root[j]
        return OPTIMAL
    guessed = guess_rows(contacts, active, as_int64(0), work.guess[:], as_int64(0))
    for f in range(FINGER_COUNT):
        if work.yields[f] >= 0:
            guessed = guess_rows(contacts, active, f + 1, work.guess[:], guessed)
    status = solve(
        work.variables,
        as_int64(6),
        problem.common[:],
        work.block[:],
        problem.rhs[:],
        work.palm_start[:],
        work.palm_stop[:],
        work.palm_block[:],
        work.palm_target[:],
        # A joint's row is longer here by YIELD_SCALE; to the finger's own program the step must be as exact as its
        # other steps.
        tolerance / YIELD_SCALE if work.variables > 6 else tolerance,
        relaxation,
        work.guess[:],
        guessed,
        qp,
    )
    step.iterations += qp.counts[1]
    if status != OPTIMAL:
        return status
    count = qp.counts[0]
    for i in range(count):
        step.row[i] = qp.active[i]
        step.multiplier[i] = qp.multiplier[i]
    step.count = count
    for j in range(6):
        step.delta[j] = qp.x[j] * problem.inverse_root[j]
    if work.variables == 6:
        correct_for_curvature(
            pose,
            contacts,
            problem.inverse_root[:],
            step.row[:],
            step.multiplier[:],
            as_int64(0),
            count,
            step.delta[:],
            as_int64(0),
            as_int64(6),
            as_int64(6),
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
    return status


@jit
def _solve_finger(
    pose: Record,
    problem: Record,
    contacts: Record,
    active: Record,
    finger: int,
    tolerance: float,
    relaxation: float,
    longest: float,
    work: Record,
    correction: Record,
    qp: QpWork,
    step: Record,
) -> int:
    offset = 6 + PHALANX_COUNT * finger
    start, stop = contacts.start[finger + 1], contacts.start[finger + 2]
    if start == stop:
        # Nothing but its limits binds it, and to those its target has been clamped, see `kernels.tick.prepare`.
        for j in range(offset, offset + PHALANX_COUNT):
            step.delta[j] = problem.target[j] * problem.inverse_root[j]
        return OPTIMAL
    work.finger_start[0] = start
    work.finger_stop[0] = stop
    work.finger_start[1] = limit_start(contacts, finger)
    work.finger_stop[1] = limit_start(contacts, finger + 1)
    finger_rhs(problem, start, stop, work.palm_step[:], work.rhs[:])
    finger_rhs(problem, work.finger_start[1], work.finger_stop[1], work.palm_step[:], work.rhs[:])
    for k in range(PHALANX_COUNT):
        work.target[k] = problem.target[offset + k]
    guessed = guess_rows(contacts, active, finger + 1, work.guess[:], as_int64(0))
    status = solve(
        as_int64(PHALANX_COUNT),
        as_int64(0),
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
    if status != OPTIMAL:
        return status
    before = step.count
    for i in range(qp.counts[0]):
        step.row[before + i] = qp.active[i]
        step.multiplier[before + i] = qp.multiplier[i]
    step.count = before + qp.counts[0]
    for k in range(PHALANX_COUNT):
        step.delta[offset + k] = qp.x[k] * problem.inverse_root[offset + k]
    correct_for_curvature(
        pose,
        contacts,
        problem.inverse_root[:],
        step.row[:],
        step.multiplier[:],
        before,
        step.count,
        step.delta[:],
        as_int64(offset),
        as_int64(PHALANX_COUNT),
        as_int64(0),
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
        step.delta[offset + k] = qp.x[k] * problem.inverse_root[offset + k]
    return status


@jit
def solve_progressive(
    pose: Record,
    problem: Record,
    contacts: Record,
    active: Record,
    tolerance: float,
    relaxation: float,
    longest: float,
    work: Record,
    correction: Record,
    qp: QpWork,
    step: Record,
) -> int:
    """Solve palm, then fingers, the palm yielding where it must; `step` is written where the status is OPTIMAL."""
    work.variables = 6
    for j in range(6):
        work.palm_target[j] = problem.target[j]
    for group in range(PALM_GROUPS):
        work.palm_start[group] = 0
        work.palm_stop[group] = 0
        work.palm_block[group] = -1
    work.palm_stop[0] = contacts.start[1]
    for f in range(FINGER_COUNT):
        work.yields[f] = -1
    while True:
        began = monotonic_ns()
        status = _solve_palm(
            pose, problem, contacts, active, tolerance, relaxation, longest, work, correction, qp, step
        )
        solved = monotonic_ns()
        step.duration[DURATION_PALM] += solved - began
        if status != OPTIMAL:
            return status
        joined = False
        for f in range(FINGER_COUNT):
            status = _solve_finger(
                pose, problem, contacts, active, f, tolerance, relaxation, longest, work, correction, qp, step
            )
            if status == INFEASIBLE and work.yields[f] < 0:
                _join(problem, contacts, f, work)
                joined = True
            elif status != OPTIMAL:
                step.duration[DURATION_FINGERS] += monotonic_ns() - solved
                return status
        step.duration[DURATION_FINGERS] += monotonic_ns() - solved
        if not joined:
            return OPTIMAL
