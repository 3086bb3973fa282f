"""Programs of real ticks, and what their solutions are judged by: what tests of the methods share."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from sphere_scenes import bumpy_ball, prepared

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.contact.linearise import ROW_CAPACITY
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import UNLIMITED, SolverOptions
from hhsim.solver.qp import QpProblem

HAND = HandModel.default("right")
TREE = bumpy_ball(600)
TICKS = 480


def harvest(method: str, motion: HandConfiguration, every: int) -> Any:
    """A solver standing before every `every`-th tick of a motion at which pairs are near, its first program prepared.

    Without a budget, so that the programs are the same whatever work is said to cost.
    """
    solver = HandSolver(HAND, TREE.arrays(), SolverOptions(method=method, budget=UNLIMITED))
    ticks = len(motion.position)
    for first in range(0, ticks, every):
        solver.run(*motion.part(first, first + every))
        if first + every < ticks and prepared(solver, motion, first + every) > 0:
            yield solver


def multipliers(solver: HandSolver, rows: NDArray[np.int64]) -> FloatArray:
    """λ of each of these rows in the step that the solver proposes, shape (rows,)."""
    step = solver.workspace.states[0].step
    whole = np.zeros(ROW_CAPACITY)
    np.add.at(whole, step.row[: step.count], step.multiplier[: step.count])
    found: FloatArray = whole[rows]
    return found


def optimum(problem: QpProblem, multiplier: FloatArray) -> FloatArray:
    """The point that these multipliers hold: G (δ - δ*) = Aᵀ λ."""
    return problem.target + problem.matrix.T @ multiplier / problem.stiffness
