"""Rows of pairs of hands' parts in the program of all, and the forces that they bear.

Both hands are as the first body sees them, in whose frame their variables are. A row may have fingers of both hands, or
two fingers of one: it is a dense one (`kernels.qp.row_scan`).
"""

import math

from hhsim.kernels.contact.hand_pairs import DEEP_HANDS, row_rest
from hhsim.kernels.hand.kinematics import DOF, FINGER_COUNT, PALM_BODY, PHALANX_COUNT
from hhsim.kernels.jit import Record, as_int64, jit
from hhsim.kernels.qp.active_set import QpWork
from hhsim.kernels.tick.step import ACTIVE_CAPACITY
from hhsim.kernels.world.columns import States, common_count, name_row

HAND_CONTACT_KEYS = -100
"""Keys of dense rows go down from here: below those of the fingers' limits, and above those of joints."""
HAND_PART = 1 << 62
"""Key of a force of a hand's part among a hand's active contacts: no contact has it, and no guess takes it for one."""


@jit
def part_targets(states: States, problem: Record, kept: float) -> None:
    """Let the targets of hands deep in each other lead out of it along the line of their palms."""
    first, second = states[0].pose.position, states[1].pose.position
    between = math.sqrt((first[0] - second[0]) ** 2 + (first[1] - second[1]) ** 2 + (first[2] - second[2]) ** 2)
    problem.hand_target[:] = 0.0
    states[0].problem.abduction_step[:] = states[1].problem.abduction_step[:] = 0.0
    for j in range(3):
        away = -0.5 * kept * (first[j] - second[j]) / max(between, DEEP_HANDS)
        problem.hand_target[j], problem.hand_target[DOF + j] = away, -away


@jit
def dense_rows(states: States, pairs: Record, offset: float, row: int, problem: Record) -> int:
    """Write the rows of pairs of hands' parts from a row on, and return the one behind them."""
    hands, fingers, weight = problem.hands, PHALANX_COUNT * FINGER_COUNT, problem.inverse_root
    problem.dense_row, problem.dense_rows = row, pairs.count
    for i in range(pairs.count):
        for j in range(common_count(problem)):
            problem.common[j, row] = 0.0
        for h in range(hands):
            palm = problem.palm[h]
            for j in range(6):
                problem.common[palm + j, row] = pairs.gradient[i, h, j] * weight[j]
            for j in range(fingers):
                problem.dense[i, fingers * h + j] = pairs.gradient[i, h, 6 + j] * weight[6 + j]
        problem.rhs[row] = row_rest(offset, states, hands, i, pairs)
        row = name_row(problem, row, HAND_CONTACT_KEYS - i, as_int64(-1), as_int64(0))
    return as_int64(row)


@jit
def guess_dense(problem: Record, pairs: Record, loaded: Record, filled: int) -> int:
    """Append the dense rows that bore a force to a guess; return its new length."""
    for i in range(pairs.count):
        if pairs.multiplier[i] > 0.0 and filled < ACTIVE_CAPACITY:
            loaded.guess[filled] = problem.dense_row + i
            filled += 1
    return filled


@jit
def read_dense(problem: Record, pairs: Record, qp: QpWork) -> None:
    """Read the multipliers of dense rows of a solution."""
    pairs.multiplier[:] = 0.0
    for i in range(qp.counts[0]):
        row = qp.active[i] - problem.dense_row
        if 0 <= row < problem.dense_rows:
            pairs.multiplier[row] += qp.multiplier[i]


@jit
def add_hand_contact_forces(states: States, pairs: Record) -> None:
    """Add the forces of hands' parts on each other to those on each hand."""
    for i in range(pairs.count):
        for side in range(2 if pairs.multiplier[i] != 0.0 else 0):
            warm, sign = states[pairs.hand[i, side]].warm, 1.0 if side == 0 else -1.0
            last = warm.count
            if last == ACTIVE_CAPACITY:
                continue
            warm.key[last], warm.body[last] = HAND_PART, min(pairs.body[i, side], PALM_BODY)
            warm.multiplier[last] = pairs.multiplier[i]
            for j in range(3):
                warm.normal[j, last], warm.point[j, last] = sign * pairs.normal[i, j], 0.0
            warm.count += 1
