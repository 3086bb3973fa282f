"""Programs of real ticks of each method, solved again by other solvers, and the correction of their steps."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from sphere_scenes import bumpy_ball, engine_of, prepared, random_targets, solve_prepared

from hhsim.arrays import FloatArray
from hhsim.hand.configuration import HandConfiguration
from hhsim.hand.model import HandModel
from hhsim.kernels.qp.active_set import OPTIMAL
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import UNBOUNDED, UNLIMITED, SolverOptions
from hhsim.solver.qp import QpProblem, dense_problem, solve

HAND = HandModel.default("right")
TREE = bumpy_ball(600)
TICKS = 480


def harvest(method: str, motion: HandConfiguration, every: int) -> Any:
    """A solver standing before every `every`-th tick of a motion at which pairs are near, its first program prepared.

    Without a budget, so that the programs are the same whatever work is said to cost, and without bound.
    """
    options = SolverOptions(method=method, budget=UNLIMITED, snap_speed=UNBOUNDED)
    solver = HandSolver(HAND, TREE.arrays(), options)
    ticks = len(motion.position)
    for first in range(0, ticks, every):
        solver.run(*motion.part(first, first + every))
        if first + every < ticks and prepared(solver, motion, first + every) > 0:
            yield solver


def multipliers(solver: HandSolver, rows: NDArray[np.int64]) -> FloatArray:
    """λ of each of these rows in the step that the solver proposes, shape (rows,)."""
    world = engine_of(solver).world
    whole = np.zeros(len(world.problem.rhs))
    np.add.at(whole, world.loaded.row[: world.loaded.count], world.loaded.multiplier[: world.loaded.count])
    found: FloatArray = whole[rows]
    return found


def optimum(problem: QpProblem, multiplier: FloatArray) -> FloatArray:
    """The point that these multipliers hold: G (δ - δ*) = Aᵀ λ."""
    return problem.target + problem.matrix.T @ multiplier / problem.stiffness


@pytest.mark.parametrize("seed", [0, 1])
# An interior-point method ends near the vertex and not at it: to 1e-8 of the energy, and in a joint to more.
@pytest.mark.parametrize(("backend", "exact"), [("quadprog", 1e-9), ("clarabel", 1e-7)])
def test_another_solver_finds_the_same_optimum(backend: str, exact: float, seed: int) -> None:
    programs, loaded = 0, 0
    for solver in harvest("coupled", random_targets(HAND, TICKS, seed), 7):
        assert solve_prepared(solver) == OPTIMAL
        problem, rows = dense_problem(engine_of(solver).method)
        multiplier = multipliers(solver, rows)
        own = optimum(problem, multiplier)
        theirs = solve(problem, backend)
        assert theirs.status == "optimal", theirs.message
        assert (multiplier >= 0.0).all()
        np.testing.assert_allclose(own, theirs.x, rtol=1e-6, atol=exact)
        assert problem.kkt_residual(own, multiplier) < 1e-8
        programs += 1
        loaded += bool(multiplier.any())
    assert programs > 20
    assert loaded > 10


def joined(state: Any) -> list[int]:
    """Fingers to which the palm yielded."""
    return [f for f in range(5) if state.progressive.yields[f] >= 0]


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_every_step_satisfies_all_rows_of_the_whole_hand(seed: int) -> None:
    solved, yielded = 0, 0
    for solver in harvest("progressive", random_targets(HAND, TICKS, seed, sweep=True), 5):
        state = solver.workspace.states[0]
        problem, _ = dense_problem(engine_of(solver).method)
        if solve_prepared(solver) != OPTIMAL:
            assert solve(problem, "quadprog").status == "infeasible"
            continue
        assert (problem.matrix @ state.step.delta - problem.rhs).min() > -1e-9
        solved += 1
        yielded += bool(joined(state))
    assert solved > 20
    assert yielded > 3
