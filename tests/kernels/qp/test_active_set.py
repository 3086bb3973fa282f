"""The active-set QP against quadprog and clarabel, its optimality conditions, and degenerate sets known to hurt."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import qpsolvers
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from qp_problems import (
    FEASIBLE_SETS,
    INFEASIBLE_SETS,
    VARIABLES,
    Maker,
    Outcome,
    Program,
    Rows,
    duplicates,
    parallel,
    rows_around,
    solve_program,
    zero_rows,
)
from sampled import sampled

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.qp.active_set import INFEASIBLE, NOT_FINITE, OPTIMAL
from hhsim.kernels.qp.row_scan import STRIP

TOLERANCE = 1e-12
RELAXATION = 1e-10
REPEATS = 60


def program_of(common: FloatArray, block: FloatArray, rhs: FloatArray, groups: Any, target: FloatArray) -> Program:
    return Program(common, block, rhs, np.array(groups), target, TOLERANCE, RELAXATION)


def dense(matrix: FloatArray, rhs: FloatArray, target: FloatArray) -> Program:
    """Rows without blocks; columns of zeros fill up their strips."""
    m, n = matrix.shape
    rest = -n % STRIP
    common = np.ascontiguousarray(np.pad(matrix.T, ((0, rest), (0, 0))))
    return program_of(common, np.zeros((3, m)), rhs, [[0], [m], [-1]], np.pad(target, (0, rest)))


def solve_dense(matrix: FloatArray, rhs: FloatArray, target: FloatArray, guess: Iterable[int] = ()) -> Outcome:
    return of_width(solve_program(dense(matrix, rhs, target), guess), matrix)


def of_width(outcome: Outcome, matrix: FloatArray) -> Outcome:
    """The outcome without the variables of columns that only fill up a strip."""
    return outcome._replace(x=outcome.x[: matrix.shape[1]])


def oracle(solver: str, matrix: FloatArray, rhs: FloatArray, target: FloatArray) -> FloatArray | None:
    clarabel = solver == "clarabel"
    options: dict[str, Any] = dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), 1e-11) if clarabel else {}
    hessian, rows = (scipy.sparse.csc_matrix(m) if clarabel else m for m in (np.eye(target.size), -matrix))
    solution = qpsolvers.solve_problem(qpsolvers.Problem(hessian, -target, rows, -rhs), solver, **options)
    return np.asarray(solution.x) if solution.found else None


def row_norms(matrix: FloatArray) -> FloatArray:
    norms: FloatArray = np.linalg.norm(matrix, axis=1)
    norms[norms == 0.0] = 1.0
    return norms


def assert_optimal(
    outcome: Outcome, matrix: FloatArray, rhs: FloatArray, target: FloatArray, residual: float = 1e-9
) -> None:
    """Primal, dual, stationarity, complementarity, with rows normalised, so that these four are lengths."""
    assert outcome.status == OPTIMAL
    norms = row_norms(matrix)
    slack = (matrix @ outcome.x - rhs) / norms
    force = outcome.multiplier * norms
    assert slack.min(initial=0.0) >= -residual
    assert force.min(initial=0.0) >= 0.0
    largest = max(1.0, float(force.max(initial=0.0)))
    np.testing.assert_allclose(outcome.x - target, (matrix / norms[:, None]).T @ force, atol=residual * largest)
    assert np.abs(slack * force).max(initial=0.0) <= residual * largest


def assert_certificate(outcome: Outcome, matrix: FloatArray, rhs: FloatArray) -> None:
    """Farkas: y >= 0, yᵀA = 0, yᵀb > 0 excludes every x."""
    assert outcome.status == INFEASIBLE
    y, norms = outcome.certificate, row_norms(matrix)
    total = y.sum()
    assert y.min() >= -1e-12 * total
    assert np.abs(y @ (matrix / norms[:, None])).max() <= 1e-12 * total
    assert y @ (rhs / norms) > 0.0


def grouped_set(rng: np.random.Generator, m: int) -> tuple[Program, IntArray]:
    """Rows as the coupled hand has them: palm contacts, limits and five fingers' contacts; and which belong to one."""
    sizes = rng.multinomial(m, np.ones(6) / 6.0)
    gaps = rng.integers(0, 3, size=6)
    start = np.cumsum(sizes + gaps) - sizes
    stop = start + sizes
    capacity = int(stop[-1]) + 2
    common, block = rng.normal(size=(6, capacity)), rng.normal(size=(3, capacity))
    inside = rng.normal(size=21)
    rows = program_of(common, block, np.zeros(capacity), [start, stop, [-1, 6, 9, 12, 15, 18]], inside)
    rhs = rows.matrix @ inside - rng.exponential(0.3, size=capacity)
    used = np.concatenate([np.arange(a, b) for a, b in zip(start, stop)])
    return replace(rows, rhs=rhs, target=inside + 2.0 * rng.normal(size=21)), used


def assert_same_optimum(solver: str, outcome: Outcome, matrix: FloatArray, rhs: FloatArray, target: FloatArray) -> None:
    assert_optimal(outcome, matrix, rhs, target)
    expected = oracle(solver, matrix, rhs, target)
    assert expected is not None
    np.testing.assert_allclose(outcome.x, expected, atol=1e-11 if solver == "quadprog" else 1e-6)


@pytest.mark.parametrize("solver", ["quadprog", "clarabel"])
@pytest.mark.parametrize("m", [5, 60, 250])
def test_grouped_rows_stand_for_their_dense_matrix(solver: str, m: int) -> None:
    rng = np.random.default_rng(m)
    for _ in range(20):
        rows, used = grouped_set(rng, m)
        outcome = solve_program(rows)
        assert set(outcome.active) <= set(used)
        own = outcome._replace(multiplier=outcome.multiplier[used])
        assert_same_optimum(solver, own, rows.matrix[used], rows.rhs[used], rows.target)


@st.composite
def contact_problems(draw: st.DrawFn) -> Rows:
    """Feasible problems with repeated directions, few distinct values and rows that touch the inside point."""
    n = draw(st.sampled_from([3, 6, 21]))
    m = draw(st.integers(0, 60))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    if draw(st.booleans()):
        matrix = rng.integers(-2, 3, size=(m, n)).astype(np.float64)
    else:
        matrix = rows_around(rng, n, max(m, 1))[0][rng.integers(0, max(1, m), size=m)]
    inside = rng.integers(-3, 4, size=n).astype(np.float64)
    slack = rng.choice([0.0, 0.0, 1e-3, 1.0], size=m)
    target = inside + draw(st.sampled_from([0.0, 1e-6, 1.0, 100.0])) * rng.normal(size=n)
    return matrix, matrix @ inside - slack, target


@settings(max_examples=300)
@given(contact_problems(), st.integers(0, 2**32 - 1), st.integers(0, 80))
def test_optimality_conditions_hold_whatever_is_guessed(problem: Rows, seed: int, count: int) -> None:
    matrix, rhs, target = problem
    cold = solve_dense(matrix, rhs, target)
    guess = np.random.default_rng(seed).integers(-5, rhs.size + 5, size=count)
    warm = solve_dense(matrix, rhs, target, guess)
    for outcome in (cold, warm):
        assert_optimal(outcome, matrix, rhs, target)
    assert len(rhs) or cold.work.counts[1] == 0
    np.testing.assert_allclose(warm.x, cold.x, atol=1e-9 * (1.0 + np.abs(target).max()))


def duplicate_normals(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target = duplicates(rng, n, m)
    return matrix, rhs - rng.choice([0.0, 1e-13, 1e-9, 1e-3], size=m), target


def rank_one_both_signs(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, _, target, inside = rows_around(rng, n, m)
    matrix = np.outer(rng.choice([-1.0, 1.0], size=m), matrix[0])
    return matrix, matrix @ inside - rng.exponential(0.3, size=m), target


FEASIBLE: dict[str, Maker] = {
    **FEASIBLE_SETS,
    "duplicate normals": duplicate_normals,
    "rank 1, both signs": rank_one_both_signs,
    "pairs parallel to 1e-11": parallel(1e-11),
    "zero rows short by rounding": zero_rows(1e-11),
}


@pytest.mark.parametrize(
    ("name", "n"),
    # Each size, and three sets of four.
    sampled([(name, n) for name in FEASIBLE for n in VARIABLES], lambda place, case: place % 4 == 0),
)
def test_degenerate_sets_are_solved(name: str, n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(REPEATS):
        matrix, rhs, target = FEASIBLE[name](rng, n, int(rng.integers(50, 101)))
        outcome = solve_dense(matrix, rhs, target)
        rhs = np.where(matrix.any(axis=1), rhs, np.minimum(rhs, 0.0))
        assert_optimal(outcome, matrix, rhs, target)
        for guess in (outcome.active, rng.integers(0, rhs.size, size=2 * n)):
            warm = solve_dense(matrix, rhs, target, guess)
            assert_optimal(warm, matrix, rhs, target)
            np.testing.assert_allclose(warm.x, outcome.x, atol=1e-9 * (1.0 + np.abs(target).max()))
        expected = oracle("quadprog", matrix, rhs, target)
        # quadprog calls some of these infeasible; where it answers, the optimum is the same.
        if expected is not None:
            found, best = (0.5 * float(((x - target) ** 2).sum()) for x in (outcome.x, expected))
            assert found == pytest.approx(best, rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("n", VARIABLES)
@pytest.mark.parametrize("name", INFEASIBLE_SETS)
def test_infeasible_sets_come_with_a_certificate(name: str, n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(REPEATS):
        matrix, rhs, target = INFEASIBLE_SETS[name](rng, n, int(rng.integers(50, 101)))
        for guess in ((), [1, 0], rng.integers(0, rhs.size, size=2 * n)):
            assert_certificate(solve_dense(matrix, rhs, target, guess), matrix, rhs)


@pytest.mark.parametrize("n", [3, 6])
def test_contradictions_within_the_relaxation_violate_no_row_by_more(n: int) -> None:
    rng = np.random.default_rng(n)
    gap = 1e-9
    for _ in range(REPEATS):
        matrix, rhs, target, inside = rows_around(rng, n, 60)
        matrix[1] = -matrix[0]
        rhs[:2] = matrix[:2] @ inside + 0.5 * gap
        outcome = of_width(solve_program(replace(dense(matrix, rhs, target), relaxation=gap)), matrix)
        assert outcome.status == OPTIMAL
        assert (matrix @ outcome.x - rhs).min() >= -1.001 * gap
        # The optimum of the rows moved back by the relaxation, exactly, unless nothing pushed against both walls.
        relaxed = solve_dense(matrix, rhs - gap, target)
        assert_optimal(relaxed, matrix, rhs - gap, target)
        np.testing.assert_allclose(outcome.x, relaxed.x, atol=1e-7)


@pytest.mark.parametrize("place", ["matrix", "rhs", "target"])
def test_nan_is_refused(place: str) -> None:
    rng = np.random.default_rng(2)
    matrix, rhs, target, _ = rows_around(rng, 6, 20)
    {"matrix": matrix[3], "rhs": rhs, "target": target}[place][4] = np.nan
    assert solve_dense(matrix, rhs, target).status == NOT_FINITE
