"""The active-set QP against quadprog and clarabel, its optimality conditions, and degenerate sets known to hurt."""

from collections.abc import Iterable
from dataclasses import astuple, dataclass
from typing import Any, NamedTuple

import numpy as np
import pytest
import qpsolvers
import scipy.sparse
from hypothesis import given, settings
from hypothesis import strategies as st
from qp_problems import FEASIBLE_SETS, Maker, Rows, duplicates, parallel, rows_around, zero_rows
from sampled import sampled

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.qp import active_set
from hhsim.kernels.qp.active_set import INFEASIBLE, NOT_FINITE, OPTIMAL, RESUMES, new_work
from hhsim.kernels.qp.row_scan import ProgramRows, WideRows

TOLERANCE = 1e-12
RELAXATION = 1e-10
REPEATS = 200


@dataclass(frozen=True)
class Layout:
    """Constraint rows in the kernel's layout, and as the dense matrix that they stand for."""

    n: int
    n_common: int
    common: FloatArray
    block: FloatArray
    rhs: FloatArray
    group_start: IntArray
    group_stop: IntArray
    group_block: IntArray

    def kernel(self) -> tuple[Any, ...]:
        return astuple(self)[1:]

    @property
    def matrix(self) -> FloatArray:
        dense = np.zeros((self.rhs.size, self.n))
        dense[:, : self.n_common] = self.common[: self.n_common].T
        for start, stop, offset in zip(self.group_start, self.group_stop, self.group_block):
            if offset >= 0:
                dense[start:stop, offset : offset + 3] = self.block[:, start:stop].T
        return dense


class Outcome(NamedTuple):
    status: int
    x: FloatArray
    multiplier: FloatArray
    work: Any

    @property
    def active(self) -> IntArray:
        return np.array(self.work.active[: self.work.counts[0]])


def outcome_of(status: int, rows: "Layout", work: Any) -> Outcome:
    multiplier = np.zeros(rows.rhs.size)
    np.add.at(multiplier, work.active[: work.counts[0]], work.multiplier[: work.counts[0]])
    return Outcome(status, work.x[: rows.n].copy(), multiplier, work)


def dense_rows(matrix: FloatArray, rhs: FloatArray) -> Layout:
    m, n = matrix.shape
    zeros = np.zeros((3, m))
    start, stop = np.array([0]), np.array([m])
    return Layout(n, n, np.ascontiguousarray(matrix.T), zeros, rhs, start, stop, np.array([-1]))


def solve_rows(
    rows: Layout,
    target: FloatArray,
    guess: Iterable[int] = (),
    tolerance: float = TOLERANCE,
    relaxation: float = RELAXATION,
) -> Outcome:
    # Nothing of the workspace may matter: fill it with rubbish.
    work = new_work(rows.n, rows.rhs.size)
    for name in work.dtype.names:
        work[name].fill(-7 if work[name].dtype == np.int64 else np.nan)
    guesses = np.array([*guess, 0], dtype=np.int64)
    program = ProgramRows(*rows.kernel())
    status = active_set.solve(rows.n, program, target, tolerance, relaxation, guesses, guesses.size - 1, work)
    return outcome_of(status, rows, work)


def solve_dense(matrix: FloatArray, rhs: FloatArray, target: FloatArray, guess: Iterable[int] = ()) -> Outcome:
    return solve_rows(dense_rows(matrix, rhs), target, guess)


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
    work, count = outcome.work, outcome.work.counts[0]
    y = np.zeros(rhs.size)
    y[work.counts[2]] = 1.0
    y[work.active[:count]] -= work.dual_step[:count]
    norms = row_norms(matrix)
    unit, scaled = matrix / norms[:, None], rhs / norms
    total = y.sum()
    assert y.min() >= -1e-12 * total
    assert np.abs(y @ unit).max() <= 1e-12 * total
    assert y @ scaled > 0.0


def grouped_set(rng: np.random.Generator, m: int) -> tuple[Layout, FloatArray]:
    """Rows as the coupled hand has them: palm contacts, limits and five fingers' contacts, with unused rows between."""
    sizes = rng.multinomial(m, np.ones(6) / 6.0)
    gaps = rng.integers(0, 3, size=6)
    start = np.cumsum(sizes + gaps) - sizes
    stop = start + sizes
    capacity = int(stop[-1]) + 2
    common, block = rng.normal(size=(6, capacity)), rng.normal(size=(3, capacity))
    group_block = np.array([-1, 6, 9, 12, 15, 18])
    rows = Layout(21, 6, common, block, np.zeros(capacity), start, stop, group_block)
    inside = rng.normal(size=21)
    rhs = rows.matrix @ inside - rng.exponential(0.3, size=capacity)
    return Layout(21, 6, common, block, rhs, start, stop, group_block), inside + 2.0 * rng.normal(size=21)


def used_rows(rows: Layout) -> IntArray:
    return np.concatenate([np.arange(a, b) for a, b in zip(rows.group_start, rows.group_stop)])


@pytest.mark.parametrize("solver", ["quadprog", "clarabel"])
@pytest.mark.parametrize(("n", "m"), [(3, 10), (3, 100), (6, 100), (21, 50), (21, 250)])
def test_same_optimum_as_another_solver(solver: str, n: int, m: int) -> None:
    rng = np.random.default_rng(n * 1000 + m)
    for _ in range(20):
        matrix, rhs, target, _ = rows_around(rng, n, m)
        outcome = solve_dense(matrix, rhs, target)
        assert_optimal(outcome, matrix, rhs, target)
        expected = oracle(solver, matrix, rhs, target)
        assert expected is not None
        np.testing.assert_allclose(outcome.x, expected, atol=1e-11 if solver == "quadprog" else 1e-6)


@pytest.mark.parametrize("solver", ["quadprog", "clarabel"])
@pytest.mark.parametrize("m", [5, 60, 250])
def test_grouped_rows_stand_for_their_dense_matrix(solver: str, m: int) -> None:
    rng = np.random.default_rng(m)
    for _ in range(20):
        rows, target = grouped_set(rng, m)
        outcome = solve_rows(rows, target)
        used = used_rows(rows)
        assert set(outcome.active) <= set(used)
        matrix, rhs = rows.matrix[used], rows.rhs[used]
        assert_optimal(outcome._replace(multiplier=outcome.multiplier[used]), matrix, rhs, target)
        expected = oracle(solver, matrix, rhs, target)
        assert expected is not None
        np.testing.assert_allclose(outcome.x, expected, atol=1e-11 if solver == "quadprog" else 1e-6)


def test_no_rows_leaves_the_target() -> None:
    target = np.array([1.0, -2.0, 3.0])
    outcome = solve_dense(np.zeros((0, 3)), np.zeros(0), target)
    assert outcome.status == OPTIMAL
    assert outcome.work.counts[1] == 0
    np.testing.assert_array_equal(outcome.x, target)


def test_multipliers_are_those_of_the_rows_as_given() -> None:
    # min ½|x|² with 10 x₀ >= 20: x₀ = 2, and λ = x₀ / 10.
    outcome = solve_dense(np.array([[10.0, 0.0, 0.0]]), np.array([20.0]), np.zeros(3))
    np.testing.assert_allclose(outcome.x, [2.0, 0.0, 0.0], rtol=1e-15)
    np.testing.assert_allclose(outcome.multiplier, [0.2], rtol=1e-15)


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
@given(contact_problems())
def test_optimality_conditions_hold(problem: Rows) -> None:
    assert_optimal(solve_dense(*problem), *problem)


@settings(max_examples=200)
@given(contact_problems(), st.integers(0, 2**32 - 1), st.integers(0, 80))
def test_any_guess_gives_the_same_optimum(problem: Rows, seed: int, count: int) -> None:
    matrix, rhs, target = problem
    cold = solve_dense(matrix, rhs, target)
    guess = np.random.default_rng(seed).integers(-5, rhs.size + 5, size=count)
    warm = solve_dense(matrix, rhs, target, guess)
    assert_optimal(warm, matrix, rhs, target)
    np.testing.assert_allclose(warm.x, cold.x, atol=1e-9 * (1.0 + np.abs(target).max()))


@settings(max_examples=200)
@given(contact_problems(), st.integers(0, 2**32 - 1))
def test_going_on_with_other_bounds_gives_the_same_optimum(problem: Rows, seed: int) -> None:
    matrix, rhs, target = problem
    rng = np.random.default_rng(seed)
    looser = rhs - rng.choice([0.0, 1e-6, 1e-3, 1.0], size=(2, rhs.size)) * rng.random((2, rhs.size))
    work = solve_dense(matrix, looser[0], target).work
    for bounds in (looser[1], rhs, looser[0]):
        rows = dense_rows(matrix, bounds)
        program = WideRows(*rows.kernel())
        none = np.empty(0, dtype=np.int64)
        status = active_set.solve(rows.n, program, target, TOLERANCE, RELAXATION, none, RESUMES, work)
        assert_optimal(outcome_of(status, rows, work), matrix, bounds, target)


def test_a_right_guess_needs_no_iteration() -> None:
    rng = np.random.default_rng(4)
    for n in (3, 6, 21):
        for _ in range(50):
            matrix, rhs, target, _ = rows_around(rng, n, 100)
            cold = solve_dense(matrix, rhs, target)
            warm = solve_dense(matrix, rhs, target, cold.active)
            assert warm.work.counts[1] == 0
            assert sorted(warm.active) == sorted(cold.active)
            np.testing.assert_allclose(warm.x, cold.x, atol=1e-12)


def test_guessed_rows_of_no_group_are_ignored() -> None:
    rng = np.random.default_rng(14)
    for _ in range(50):
        rows, target = grouped_set(rng, 60)
        cold = solve_rows(rows, target)
        unused = sorted(set(range(rows.rhs.size)) - set(used_rows(rows)))
        warm = solve_rows(rows, target, [*unused, -1, rows.rhs.size, 10**6, *cold.active])
        assert sorted(warm.active) == sorted(cold.active)
        np.testing.assert_allclose(warm.x, cold.x, atol=1e-12)


def duplicate_normals(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target = duplicates(rng, n, m)
    return matrix, rhs - rng.choice([0.0, 1e-13, 1e-9, 1e-3], size=m), target


def rank_one_both_signs(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, _, target, inside = rows_around(rng, n, m)
    matrix = np.outer(rng.choice([-1.0, 1.0], size=m), matrix[0])
    return matrix, matrix @ inside - rng.exponential(0.3, size=m), target


def corridor(rng: np.random.Generator, n: int, m: int, angle: float) -> Rows:
    """Opposed pairs of rows, parallel up to the angle; a pair that touches leaves a wedge, its tip the inside point."""
    matrix, _, target, inside = rows_around(rng, n, m)
    half = m // 2
    matrix[half : 2 * half] = angle * rng.normal(size=(half, n)) - matrix[:half]
    return matrix, matrix @ inside - rng.choice([0.0, 1.0], size=m), target


FEASIBLE: dict[str, Maker] = {
    **FEASIBLE_SETS,
    "duplicate normals": duplicate_normals,
    "rank 1, both signs": rank_one_both_signs,
    "pairs parallel to 1e-11": parallel(1e-11),
    "zero rows short by rounding": zero_rows(1e-11),
}


@pytest.mark.parametrize(
    ("name", "n"),
    # One size of each, the smaller of one and the larger of the next.
    sampled([(name, n) for name in FEASIBLE for n in (3, 6)], lambda place, case: place % 4 in (0, 3)),
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
            assert found == pytest.approx(best, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("n", [3, 6, 21])
@pytest.mark.parametrize("angle", [1e-5, 1e-9])
def test_corridors_between_opposed_walls_are_never_called_infeasible(n: int, angle: float) -> None:
    rng = np.random.default_rng(n)
    for _ in range(REPEATS):
        matrix, rhs, target = corridor(rng, n, int(rng.integers(50, 101)), angle)
        for guess in ((), rng.integers(0, rhs.size, size=n)):
            outcome = solve_dense(matrix, rhs, target, guess)
            assert_optimal(outcome, matrix, rhs, target)


@pytest.mark.parametrize("n", [3, 6])
@pytest.mark.parametrize("gap", [1.0, 1e-9])
@pytest.mark.parametrize("rows_in_conflict", ["two", "n+1"])
def test_infeasible_sets_come_with_a_certificate(n: int, gap: float, rows_in_conflict: str) -> None:
    rng = np.random.default_rng(n)
    for _ in range(REPEATS):
        matrix, rhs, target, inside = rows_around(rng, n, int(rng.integers(50, 101)))
        if rows_in_conflict == "two":
            matrix[1] = -matrix[0]
            rhs[:2] = matrix[:2] @ inside + 0.5 * gap
        else:
            opposite = -rng.uniform(0.2, 1.0, size=n) @ matrix[:n]
            matrix[n] = opposite / np.linalg.norm(opposite)
            rhs[: n + 1] = matrix[: n + 1] @ inside + 0.5 * gap
        for guess in ((), [1, 0], rng.integers(0, rhs.size, size=2 * n)):
            assert_certificate(solve_dense(matrix, rhs, target, guess), matrix, rhs)


def test_a_zero_row_that_demands_something_is_its_own_certificate() -> None:
    rng = np.random.default_rng(1)
    for n in (3, 6):
        for short in (1.0, 1e-9):
            matrix, rhs, target = zero_rows(short)(rng, n, 60)
            outcome = solve_dense(matrix, rhs, target)
            assert_certificate(outcome, matrix, rhs)
            assert not matrix[outcome.work.counts[2]].any()


@pytest.mark.parametrize("n", [3, 6])
def test_contradictions_within_the_relaxation_violate_no_row_by_more(n: int) -> None:
    rng = np.random.default_rng(n)
    gap = 1e-9
    for _ in range(REPEATS):
        matrix, rhs, target, inside = rows_around(rng, n, 60)
        matrix[1] = -matrix[0]
        rhs[:2] = matrix[:2] @ inside + 0.5 * gap
        outcome = solve_rows(dense_rows(matrix, rhs), target, relaxation=gap)
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
