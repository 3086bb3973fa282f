"""The coupled program, harvested from real ticks, solved again by other solvers."""

import numpy as np
import pytest
from harvested_programs import HAND, TICKS, TREE, harvest, multipliers, optimum
from sphere_scenes import prepared, random_targets, solve_prepared

from hhsim.kernels.qp.active_set import OPTIMAL
from hhsim.solver.contact_qp import coupled_problem
from hhsim.solver.hand_solver import HandSolver
from hhsim.solver.options import SolverOptions
from hhsim.solver.qp import solve


@pytest.mark.parametrize("seed", [0, 1])
# An interior-point method ends near the vertex and not at it: to 1e-8 of the energy, and in a joint to more.
@pytest.mark.parametrize(("backend", "exact"), [("quadprog", 1e-9), ("clarabel", 1e-7)])
def test_another_solver_finds_the_same_optimum(backend: str, exact: float, seed: int) -> None:
    programs, loaded = 0, 0
    for solver in harvest("coupled", random_targets(HAND, TICKS, seed), 7):
        assert solve_prepared(solver) == OPTIMAL
        problem, rows = coupled_problem(solver.workspace.states[0])
        multiplier = multipliers(solver, rows)
        own = optimum(problem, multiplier)
        theirs = solve(problem, backend)
        assert theirs.status == "optimal", theirs.message
        assert (multiplier >= 0.0).all()
        np.testing.assert_allclose(own, theirs.x, rtol=1e-6, atol=exact)
        assert problem.objective(own) == pytest.approx(problem.objective(theirs.x), rel=1e-8, abs=1e-12)
        assert problem.kkt_residual(own, multiplier) < 1e-8
        programs += 1
        loaded += bool(multiplier.any())
    assert programs > 20
    assert loaded > 10


@pytest.mark.parametrize("seed", [2, 3])
def test_the_step_satisfies_every_row_and_keeps_the_loaded_ones(seed: int) -> None:
    # The step is the optimum, corrected for curvature within the rows that carry force.
    programs = 0
    for solver in harvest("coupled", random_targets(HAND, TICKS, seed, sweep=True), 7):
        state = solver.workspace.states[0]
        assert solve_prepared(solver) == OPTIMAL
        problem, rows = coupled_problem(state)
        slack = problem.matrix @ state.step.delta - problem.rhs
        assert slack.min() > -1e-10
        loaded = multipliers(solver, rows) > 0.0
        np.testing.assert_allclose(slack[loaded], 0.0, atol=1e-10)
        programs += 1
    assert programs > 20


def test_the_step_does_not_depend_on_the_guess() -> None:
    motion = random_targets(HAND, TICKS, 4)
    compared = 0
    for solver in harvest("coupled", motion, 11):
        state = solver.workspace.states[0]
        assert solve_prepared(solver) == OPTIMAL
        warm, iterations = state.step.delta.copy(), int(solver.workspace.qp.counts[1])
        state.warm.count = 0
        assert solve_prepared(solver) == OPTIMAL
        np.testing.assert_allclose(state.step.delta, warm, rtol=1e-7, atol=1e-9)
        compared += int(solver.workspace.qp.counts[1]) != iterations
    assert compared > 3, "no guess ever changed the way to the solution"


def test_standing_still_is_always_allowed_when_relaxed() -> None:
    motion = random_targets(HAND, TICKS, 5)
    seen = 0
    solver = HandSolver(HAND, TREE.arrays(), SolverOptions())
    for tick in range(0, TICKS - 1, 9):
        solver.run(*motion.part(tick, tick + 9))
        if tick + 9 >= TICKS or prepared(solver, motion, tick + 9, relaxed=True) == 0:
            continue
        problem, _ = coupled_problem(solver.workspace.states[0])
        assert (problem.rhs <= 0.0).all()
        assert solve_prepared(solver) == OPTIMAL
        seen += 1
    assert seen > 10


def test_contradicting_rows_are_reported_and_nothing_is_written() -> None:
    motion = random_targets(HAND, TICKS, 6)
    for solver in harvest("coupled", motion, 5):
        state = solver.workspace.states[0]
        if state.contacts.start[-1] < 2:
            continue
        problem = state.problem
        problem.common[:, 1] = -problem.common[:, 0]
        problem.block[:, 1] = -problem.block[:, 0]
        problem.rhs[:2] = 1e-3
        if state.contacts.body[0] // 3 != state.contacts.body[1] // 3:
            continue
        before = state.step.delta.copy()
        assert solve_prepared(solver) != OPTIMAL
        np.testing.assert_array_equal(state.step.delta, before)
        return
    pytest.fail("no tick with two contacts of one body")
