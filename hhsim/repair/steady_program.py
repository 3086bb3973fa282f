"""Quadratic program of the hands of consecutive frames: the least displacement whose change is steady.

Each frame has a cost and rows of its own. Frames are tied by the second differences of their change. Clarabel solves
the program of all frames at once.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.repair.hand_change import NUMBERS

SLACK = 1000.0
"""Force [N], above that of any displacement, at which rows that contradict each other give way."""
TOLERANCE = 1e-6
"""Relative gap, and violation of rows, at which Clarabel ends."""


class FrameProgram(NamedTuple):
    """Program of a frame: least x·H·x / 2 − p·x with rows · x ≥ bounds; H is `hessian`, p is `pull`.

    The first 26 of the n variables are the next change of the hand; others are slacks of rows that may give way.
    """

    hessian: FloatArray
    pull: FloatArray
    rows: FloatArray
    bounds: FloatArray


def steady_step(
    programs: Sequence[FrameProgram], change: FloatArray, frames: Sequence[int], steadiness: float
) -> FloatArray | None:
    """Compute the next changes of these frames, shape (n, 26); None if the solver finds none.

    Args:
        programs: Program of each frame that may change.
        change: Change of all T frames so far, shape (T, 26).
        frames: Frames of the programs, ascending.
        steadiness: Weight of a squared second difference of a number of the change, against that of the number in H.
    """
    import clarabel
    import scipy.sparse

    sparse: Any = scipy.sparse

    count, total = len(programs), len(change)
    metric = steadiness * np.mean([np.diag(program.hessian)[:NUMBERS] for program in programs], axis=0)
    one = sparse.eye_array(total).tocsr()
    second = (one[2:] - 2.0 * one[1:-1] + one[:-2]).tocsc()
    own = second[:, frames]
    hessian = sparse.block_diag([program.hessian for program in programs])
    sizes = [len(program.pull) for program in programs]
    first = np.cumsum([0, *sizes[:-1]])[:, None] + np.arange(NUMBERS)
    change_of = sparse.eye_array(sum(sizes)).tocsr()[first.ravel()]
    hessian += change_of.T @ sparse.kron(own.T @ own, sparse.diags_array(metric)) @ change_of
    linear = change_of.T @ ((own.T @ (second @ change)) * metric).ravel()
    linear -= np.concatenate([program.pull for program in programs])
    # One slack for all rows of a frame, so that the program always has a solution.
    rows = sparse.block_diag([-program.rows for program in programs])
    slack = sparse.block_diag([-np.ones((len(program.bounds), 1)) for program in programs])
    matrix = sparse.block_array([[rows, slack], [None, -sparse.eye_array(count)]]).tocsc()
    bounds = np.concatenate([*(-program.bounds for program in programs), np.zeros(count)])
    quadratic = sparse.block_diag([sparse.triu(hessian), sparse.eye_array(count)]).tocsc()
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    linear = np.concatenate([linear, np.full(count, SLACK)])
    cones = [clarabel.NonnegativeConeT(len(bounds))]
    solution = clarabel.DefaultSolver(quadratic, linear, matrix, bounds, cones, settings).solve()
    if str(solution.status) not in {"Solved", "AlmostSolved"}:
        return None
    return np.asarray(solution.x)[first]
