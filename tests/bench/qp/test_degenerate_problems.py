"""The degenerate sets, of which ours solves or refuses every one, and the checks of an answer."""

import numpy as np
import pytest
from qp_problems import (
    FEASIBLE_SETS,
    INFEASIBLE_SETS,
    VARIABLES,
    degenerate_set,
    dense_program,
    least_violation,
)

from hhsim.bench.qp.bench import OWN_LIMIT
from hhsim.bench.qp.program import CERTIFIED_RADIUS, ProgramSolver, certified_radius, residual, violation

COUNT = 20
SOLVER = ProgramSolver()


@pytest.mark.parametrize("variables", VARIABLES)
@pytest.mark.parametrize("name", FEASIBLE_SETS)
def test_a_set_with_a_solution_is_solved_exactly(name: str, variables: int) -> None:
    for program in degenerate_set(name, variables, COUNT, seed=3):
        assert 50 <= program.rows <= 100
        answer = SOLVER.solve(program)
        assert answer.x is not None
        assert residual(program, answer.x, answer.multiplier) <= OWN_LIMIT


@pytest.mark.parametrize("variables", VARIABLES)
@pytest.mark.parametrize("name", INFEASIBLE_SETS)
def test_a_set_without_a_solution_is_refused_with_a_proof(name: str, variables: int) -> None:
    for program in degenerate_set(name, variables, COUNT, seed=3):
        answer = SOLVER.solve(program)
        assert answer.certificate is not None
        assert certified_radius(program, answer.certificate) > (1e12 if name == "infeasible by 1" else CERTIFIED_RADIUS)
        least = least_violation(program)
        assert least > (1e-2 if name == "infeasible by 1" else 0.0)


def test_residuals_are_in_sizes_of_the_program() -> None:
    program = dense_program("", np.eye(3), np.zeros(3), np.array([-1.0, 1.0, 1.0]), 1e-12)
    size = program.size
    assert size == pytest.approx(np.sqrt(3.0))
    best, push = np.array([0.0, 1.0, 1.0]), np.array([1.0, 0.0, 0.0])
    away = best - [0.1, 0.0, 0.0]
    assert residual(program, best, push) == violation(program, best) == 0.0
    assert residual(program, away, push) == violation(program, away) == pytest.approx(0.1 / size)
    assert residual(program, away, push + [-0.1, 0.0, 0.0], moved_back=0.1) == pytest.approx(0.0)
    assert residual(program, best, 0.5 * push) == pytest.approx(0.5 / size)
    assert residual(program, best, push + [0.0, 0.2, 0.0]) == pytest.approx(0.2 / size)
    assert residual(program, best * np.nan, push) == np.inf


def test_a_certificate_must_hold() -> None:
    matrix = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    program = dense_program("", matrix, np.array([1.0, 1.0, 0.0]), np.zeros(3), 1e-12)
    assert certified_radius(program, np.array([1.0, 1.0, 0.0])) == np.inf
    assert certified_radius(program, np.array([1.0, 0.0, 0.0])) == pytest.approx(1.0)
    assert certified_radius(program, np.array([1.0, 1.0, 1e-9])) == pytest.approx(2e9)
    assert certified_radius(program, np.array([1.0, 1.0, -1.0])) == 0.0
    assert certified_radius(program, np.array([1.0, np.nan, 0.0])) == 0.0
    assert certified_radius(program, np.array([0.0, 0.0, 1.0])) == 0.0
    assert least_violation(program) == pytest.approx(1.0, abs=1e-8)
