"""The active-set QP against quadprog, its optimality conditions, and degenerate sets known to hurt.

Rows in groups, as a hand has them, are in `tests/kernels/tick/test_programs.py`.
"""

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
import pytest
import qpsolvers
from conftest import sampled
from hypothesis import given, settings
from hypothesis import strategies as st

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.qp import active_set
from hhsim.kernels.qp.active_set import INFEASIBLE, NOT_FINITE, OPTIMAL
from hhsim.kernels.qp.row_scan import STRIP
from hhsim.kernels.qp.row_scan import Rows as KernelRows

Rows = tuple[FloatArray, FloatArray, FloatArray]
"""Matrix (m, n), right-hand side (m,), target (n,)."""
Maker = Callable[[np.random.Generator, int, int], Rows]

VARIABLES = (3, 6, 21)
TOLERANCE = 1e-12
RELAXATION = 1e-10
REPEATS = 60


def rows_around(rng: np.random.Generator, n: int, m: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rows that a point inside satisfies with some slack, about half of them violated by the target; and the point.

    They have length 1 and the pattern of a hand's: six columns of the palm, three of one finger.
    """
    matrix: FloatArray = rng.normal(size=(m, n))
    if n > 6:
        owner = rng.integers(0, 1 + (n - 6) // 3, size=m)
        column = np.arange(n - 6) // 3 + 1
        matrix[:, 6:] *= column[None, :] == owner[:, None]
    matrix /= np.linalg.norm(matrix, axis=1)[:, None]
    inside = rng.normal(size=n)
    return matrix, matrix @ inside - rng.exponential(0.3, size=m), inside + 2.0 * rng.normal(size=n), inside


def duplicates(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target, _ = rows_around(rng, n, m)
    half = m // 2
    matrix[half : 2 * half], rhs[half : 2 * half] = matrix[:half], rhs[:half]
    return matrix, rhs - rng.choice([0.0, 1e-13, 1e-9, 1e-3], size=m) * (rng.random() < 0.5), target


def rank_one(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, _, target, inside = rows_around(rng, n, m)
    matrix = np.outer(rng.uniform(0.1, 2.0, size=m) * rng.choice([-1.0, 1.0], size=m), matrix[0])
    return matrix, matrix @ inside - rng.exponential(0.3, size=m), target


def parallel(angle: float) -> Maker:
    def make(rng: np.random.Generator, n: int, m: int) -> Rows:
        matrix, rhs, target, inside = rows_around(rng, n, m)
        half = m // 2
        # Where the first of a pair has none, the second has no finger's column either.
        tilt = angle * rng.normal(size=(half, n)) * (matrix[:half] != 0.0)
        matrix[half : 2 * half] = matrix[:half] + tilt
        apart = rng.choice([0.0, angle, 1e-3], size=half) * rng.random(half)
        rhs[half : 2 * half] = matrix[half : 2 * half] @ inside - (matrix[:half] @ inside - rhs[:half]) - apart
        return matrix, rhs, target

    return make


def zero_rows(rhs_of_zero: float) -> Maker:
    def make(rng: np.random.Generator, n: int, m: int) -> Rows:
        matrix, rhs, target, _ = rows_around(rng, n, m)
        zero = rng.random(m) < 0.2
        zero[0] = True
        matrix[zero], rhs[zero] = 0.0, rhs_of_zero
        return matrix, rhs, target

    return make


def boundary(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, _, inside = rows_around(rng, n, m)
    # The target is feasible, and several rows hold there with equality: nothing is to be done.
    touching = rng.random(m) < 0.2
    touching[0] = True
    return matrix, np.where(touching, matrix @ inside, rhs), inside


def scaled(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target, _ = rows_around(rng, n, m)
    factor = 10.0 ** rng.uniform(-6.0, 6.0, size=m)
    return matrix * factor[:, None], rhs * factor, target


def mixed_units(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target, _ = rows_around(rng, n, m)
    # As if some variables were in metres and others in millimetres or milliradians.
    unit = np.where(np.arange(n) % 3 == 0, 1e3, np.where(np.arange(n) % 3 == 1, 1.0, 1e-1))
    return matrix / unit, rhs, target * unit


def vertex(rng: np.random.Generator, n: int, m: int) -> Rows:
    # All rows meet in one point and push: more than n are active there.
    matrix, _, _, tip = rows_around(rng, n, m)
    matrix *= np.where(matrix @ matrix[0] < 0.0, -1.0, 1.0)[:, None]
    return matrix, matrix @ tip, tip - matrix.T @ rng.exponential(1.0, size=m)


def contradiction(gap: float) -> Maker:
    def make(rng: np.random.Generator, n: int, m: int) -> Rows:
        matrix, rhs, target, inside = rows_around(rng, n, m)
        if rng.random() < 0.5:
            # Two opposed walls.
            matrix[1] = -matrix[0]
            rhs[:2] = matrix[:2] @ inside + 0.5 * gap
            return matrix, rhs, target
        # k + 1 rows around a point, in the k columns that the palm (or the finger) has.
        k = min(n, 6)
        matrix[: k + 1, k:] = 0.0
        matrix[:k] /= np.linalg.norm(matrix[:k], axis=1)[:, None]
        opposite = -rng.uniform(0.2, 1.0, size=k) @ matrix[:k]
        matrix[k] = opposite / np.linalg.norm(opposite)
        rhs[: k + 1] = matrix[: k + 1] @ inside + 0.5 * gap
        return matrix, rhs, target

    return make


FEASIBLE: dict[str, Maker] = {
    "duplicate rows": duplicates,
    "all rows of rank 1": rank_one,
    "pairs parallel to 1e-9": parallel(1e-9),
    "pairs parallel to 1e-5": parallel(1e-5),
    "zero rows, rhs 0": zero_rows(0.0),
    "zero rows, rhs -1": zero_rows(-1.0),
    "start on the boundary": boundary,
    "rows scaled 1e-6 to 1e6": scaled,
    "mm and rad mixed": mixed_units,
    "more than n active": vertex,
    "pairs parallel to 1e-11": parallel(1e-11),
    "zero rows short by rounding": zero_rows(1e-11),
}
INFEASIBLE_SETS: dict[str, Maker] = {"infeasible by 1": contradiction(1.0), "infeasible by 1e-9": contradiction(1e-9)}


class Outcome(NamedTuple):
    """Answer of the active set, and its workspace."""

    status: int
    x: FloatArray
    multiplier: FloatArray
    work: Any

    @property
    def active(self) -> IntArray:
        return np.array(self.work.active[: self.work.counts[0]])

    @property
    def certificate(self) -> FloatArray:
        """Farkas' y >= 0 for the normalised rows, which proves that these contradict each other."""
        y = np.zeros(self.multiplier.size)
        y[self.work.counts[2]] = 1.0
        y[self.active] -= self.work.dual_step[: self.work.counts[0]]
        return y


def solve(
    matrix: FloatArray, rhs: FloatArray, target: FloatArray, guess: Iterable[int] = (), relaxation: float = RELAXATION
) -> Outcome:
    """Rows without blocks; columns of zeros fill up their strips, and the workspace is full of rubbish."""
    m, n = matrix.shape
    rest = -n % STRIP
    common = np.ascontiguousarray(np.pad(matrix.T, ((0, rest), (0, 0))))
    rows = KernelRows(n + rest, common, np.zeros((3, m)), rhs, np.zeros(1, int), np.full(1, m), np.full(1, -1))
    work: Any = active_set.new_work(n + rest, m)
    for name in work.dtype.names:
        work[name].fill(-7 if work[name].dtype == np.int64 else np.nan)
    guesses = np.array([*guess, 0], dtype=np.int64)
    limits = (TOLERANCE, relaxation)
    status = active_set.solve(n + rest, rows, np.pad(target, (0, rest)), *limits, guesses, guesses.size - 1, work)
    multiplier = np.zeros(m)
    np.add.at(multiplier, work.active[: work.counts[0]], work.multiplier[: work.counts[0]])
    return Outcome(status, work.x[:n].copy(), multiplier, work)


def row_norms(matrix: FloatArray) -> FloatArray:
    norms: FloatArray = np.linalg.norm(matrix, axis=1)
    norms[norms == 0.0] = 1.0
    return norms


def assert_optimal(outcome: Outcome, matrix: FloatArray, rhs: FloatArray, target: FloatArray) -> None:
    """Primal, dual, stationarity, complementarity, with rows normalised, so that these four are lengths."""
    residual = 1e-9
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
    cold = solve(matrix, rhs, target)
    guess = np.random.default_rng(seed).integers(-5, rhs.size + 5, size=count)
    warm = solve(matrix, rhs, target, guess)
    for outcome in (cold, warm):
        assert_optimal(outcome, matrix, rhs, target)
    assert len(rhs) or cold.work.counts[1] == 0
    np.testing.assert_allclose(warm.x, cold.x, atol=1e-9 * (1.0 + np.abs(target).max()))


@pytest.mark.parametrize(
    ("name", "n"),
    # Each size, and three sets of four.
    sampled([(name, n) for name in FEASIBLE for n in VARIABLES], lambda place, case: place % 4 == 0),
)
def test_degenerate_sets_are_solved(name: str, n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(REPEATS):
        matrix, rhs, target = FEASIBLE[name](rng, n, int(rng.integers(50, 101)))
        outcome = solve(matrix, rhs, target)
        rhs = np.where(matrix.any(axis=1), rhs, np.minimum(rhs, 0.0))
        assert_optimal(outcome, matrix, rhs, target)
        for guess in (outcome.active, rng.integers(0, rhs.size, size=2 * n)):
            warm = solve(matrix, rhs, target, guess)
            assert_optimal(warm, matrix, rhs, target)
            np.testing.assert_allclose(warm.x, outcome.x, atol=1e-9 * (1.0 + np.abs(target).max()))
        expected = qpsolvers.solve_problem(qpsolvers.Problem(np.eye(n), -target, -matrix, -rhs), "quadprog")
        # quadprog calls some of these infeasible; where it answers, the optimum is the same.
        if expected.found:
            found, best = (0.5 * float(((x - target) ** 2).sum()) for x in (outcome.x, expected.x))
            assert found == pytest.approx(best, rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("n", VARIABLES)
@pytest.mark.parametrize("name", INFEASIBLE_SETS)
def test_infeasible_sets_come_with_a_certificate(name: str, n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(REPEATS):
        matrix, rhs, target = INFEASIBLE_SETS[name](rng, n, int(rng.integers(50, 101)))
        for guess in ((), [1, 0], rng.integers(0, rhs.size, size=2 * n)):
            assert_certificate(solve(matrix, rhs, target, guess), matrix, rhs)


@pytest.mark.parametrize("n", [3, 6])
def test_contradictions_within_the_relaxation_violate_no_row_by_more(n: int) -> None:
    rng = np.random.default_rng(n)
    gap = 1e-9
    for _ in range(REPEATS):
        matrix, rhs, target, inside = rows_around(rng, n, 60)
        matrix[1] = -matrix[0]
        rhs[:2] = matrix[:2] @ inside + 0.5 * gap
        outcome = solve(matrix, rhs, target, relaxation=gap)
        assert outcome.status == OPTIMAL
        assert (matrix @ outcome.x - rhs).min() >= -1.001 * gap
        # The optimum of the rows moved back by the relaxation, exactly, unless nothing pushed against both walls.
        relaxed = solve(matrix, rhs - gap, target)
        assert_optimal(relaxed, matrix, rhs - gap, target)
        np.testing.assert_allclose(outcome.x, relaxed.x, atol=1e-7)


@pytest.mark.parametrize("place", ["matrix", "rhs", "target"])
def test_nan_is_refused(place: str) -> None:
    rng = np.random.default_rng(2)
    matrix, rhs, target, _ = rows_around(rng, 6, 20)
    {"matrix": matrix[3], "rhs": rhs, "target": target}[place][4] = np.nan
    assert solve(matrix, rhs, target).status == NOT_FINITE
