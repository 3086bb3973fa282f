"""The programs of a tick as `QpProblem`s, taken from the kernels' rows: to inspect, to solve again, to compare."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.hand import DOF, FINGER_COUNT, PHALANX_COUNT
from hhsim.kernels.linearise import LIMIT_ROWS
from hhsim.qp import QpProblem

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LIMITS_PER_FINGER = LIMIT_ROWS // FINGER_COUNT


def finger_rows(state: Any, finger: int) -> IntArray:
    """Rows of one finger: its contacts, then its six joint limits."""
    start = state.contacts.start
    limits = start[-1] + LIMITS_PER_FINGER * finger
    return np.concatenate(
        [np.arange(start[finger + 1], start[finger + 2]), np.arange(limits, limits + LIMITS_PER_FINGER)]
    )


def coupled_problem(state: Any) -> tuple[QpProblem, IntArray]:
    """The coupled program at the present linearisation and the kernels' row of each of its rows.

    Args:
        state: a tick's state after `kernels.tick.prepare` has found contacts.
    """
    problem, start = state.problem, state.contacts.start
    rows = [np.arange(start[0], start[1])]
    matrix = [np.zeros((start[1] - start[0], DOF))]
    matrix[0][:, :6] = problem.common[:, rows[0]].T
    for finger in range(FINGER_COUNT):
        own = finger_rows(state, finger)
        part = np.zeros((own.size, DOF))
        part[:, :6] = problem.common[:, own].T
        first = 6 + PHALANX_COUNT * finger
        part[:, first : first + PHALANX_COUNT] = problem.block[:, own].T
        rows.append(own)
        matrix.append(part)
    index = np.concatenate(rows)
    return _unscaled(state, np.concatenate(matrix), problem.rhs[index], problem.target, slice(0, DOF)), index


def palm_problem(state: Any) -> tuple[QpProblem, IntArray]:
    """The palm's program of the progressive method, cuts included, and the kernels' row of each of its rows."""
    problem, groups = state.problem, state.progressive
    index = np.concatenate([np.arange(a, b) for a, b in zip(groups.palm_start, groups.palm_stop)])
    matrix = problem.common[:, index].T
    return _unscaled(state, matrix, problem.rhs[index], problem.target[:6], slice(0, 6)), index


def finger_problem(state: Any, finger: int, palm_step: FloatArray) -> tuple[QpProblem, IntArray]:
    """A finger's program once the palm has taken its step (6,) [m, rad], and the kernels' row of each of its rows."""
    problem = state.problem
    index = finger_rows(state, finger)
    first = 6 + PHALANX_COUNT * finger
    part = slice(first, first + PHALANX_COUNT)
    rhs = problem.rhs[index] - problem.common[:, index].T @ (palm_step / problem.inverse_root[:6])
    return _unscaled(state, problem.block[:, index].T, rhs, problem.target[part], part), index


def _unscaled(state: Any, matrix: FloatArray, rhs: FloatArray, target: FloatArray, part: slice) -> QpProblem:
    weight = state.problem.inverse_root[part]
    return QpProblem(
        stiffness=np.array(state.stiffness[part]), matrix=matrix / weight, rhs=np.array(rhs), target=target * weight
    )
