"""The degenerate sets: that they are what they say, and that ours solves or refuses every one of them."""

import numpy as np
import pytest
from qp_problems import (
    FEASIBLE_SETS,
    INFEASIBLE_SETS,
    SIZES,
    VARIABLES,
    contact_programs,
    degenerate_set,
    dense_program,
    least_violation,
)

from hhsim.bench.qp.bench import OWN_LIMIT
from hhsim.bench.qp.program import CERTIFIED_RADIUS, Program, ProgramSolver, certified_radius, residual, violation

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


def of(name: str, variables: int = 6) -> list[Program]:
    return list(degenerate_set(name, variables, COUNT, seed=0))


@pytest.mark.parametrize("variables", VARIABLES)
def test_each_set_is_what_its_name_says(variables: int) -> None:
    for program in of("duplicate rows", variables):
        rows = np.column_stack([program.matrix, program.rhs])
        assert len(np.unique(rows, axis=0)) <= (program.rows + 1) // 2
    for program in of("all rows of rank 1", variables):
        assert np.linalg.matrix_rank(program.matrix) == 1
    for angle in (1e-9, 1e-5):
        for program in of(f"pairs parallel to {angle:.0e}".replace("e-0", "e-"), variables):
            unit = program.matrix / np.linalg.norm(program.matrix, axis=1)[:, None]
            apart = np.array([np.sort(np.linalg.norm(unit - row, axis=1))[1] for row in unit])
            assert np.median(apart) < 10.0 * angle
    for program in of("zero rows, rhs 0", variables):
        zero = ~program.matrix.any(axis=1)
        assert zero.any()
        assert not program.rhs[zero].any()
    for program in of("start on the boundary", variables):
        slack = program.matrix @ program.target - program.rhs
        assert slack.min() > -1e-12
        assert (slack < 1e-12).any()
        x = SOLVER.solve(program).x
        assert x is not None
        np.testing.assert_allclose(x, program.target, atol=1e-12)
    for program in of("rows scaled 1e-6 to 1e6", variables):
        norm = np.linalg.norm(program.matrix, axis=1)
        assert norm.max() / norm.min() > 1e8
    for program in of("more than n active", variables):
        x = SOLVER.solve(program).x
        assert x is not None
        assert np.sum(np.abs(program.matrix @ x - program.rhs) < 1e-9) > program.variables


@pytest.mark.parametrize(("variables", "rows"), SIZES)
def test_programs_of_the_timed_sizes_have_work_in_them(variables: int, rows: int) -> None:
    active = []
    for program in contact_programs(variables, rows, 5, seed=0):
        assert (program.variables, program.rows) == (variables, rows)
        answer = SOLVER.solve(program)
        assert answer.x is not None
        assert residual(program, answer.x, answer.multiplier) <= OWN_LIMIT
        active.append(np.count_nonzero(answer.multiplier))
    assert max(active) >= min(3, rows // 10)


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
