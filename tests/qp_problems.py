"""Programs for tests: rows in the kernels' layout, degenerate sets; and the active set's answers to them."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.qp import active_set, row_scan
from hhsim.solver.qp import QpProblem

Rows = tuple[FloatArray, FloatArray, FloatArray]
"""Matrix (m, n), right-hand side (m,), target (n,)."""
Maker = Callable[[np.random.Generator, int, int], Rows]

VARIABLES = (3, 6, 21)


def energy(problem: QpProblem, solution: FloatArray) -> float:
    """The coupling's energy [J] of a step δ, shape (n,)."""
    offset = solution - problem.target
    return 0.5 * float(offset @ (problem.stiffness * offset))


@dataclass(frozen=True)
class Program:
    """One program in the kernels' layout: minimise ½ |x - x₀|² subject to a_i · x >= b_i.

    Attributes:
        common: Columns that all rows share, shape (0 or 6, m).
        block: Three more columns, shape (3, m), of the variables of the row's group.
        rhs: b, shape (m,).
        groups: First row of each group, the row after its last, and the first variable of its block (-1 for none);
            shape (3, groups).
        target: x₀, shape (n,).
        tolerance: Violation that counts as satisfied.
        relaxation: Largest distance by which contradicting rows are moved back.
    """

    common: FloatArray
    block: FloatArray
    rhs: FloatArray
    groups: IntArray
    target: FloatArray
    tolerance: float
    relaxation: float

    @property
    def variables(self) -> int:
        """Number of variables n."""
        return self.target.size

    @property
    def rows(self) -> int:
        """Number of rows m."""
        return self.rhs.size

    @property
    def matrix(self) -> FloatArray:
        """Rows a_i, shape (m, n)."""
        dense = np.zeros((self.rows, self.variables))
        dense[:, : len(self.common)] = self.common.T
        for start, stop, first in self.groups.T:
            if first >= 0:
                dense[start:stop, first : first + 3] = self.block[:, start:stop].T
        return dense


def _hand_rows(rng: np.random.Generator, n: int, m: int) -> FloatArray:
    """Rows of length 1 in the pattern of a hand's: six columns of the palm, three of one finger."""
    matrix: FloatArray = rng.normal(size=(m, n))
    if n > 6:
        owner = rng.integers(0, 1 + (n - 6) // 3, size=m)
        column = np.arange(n - 6) // 3 + 1
        matrix[:, 6:] *= column[None, :] == owner[:, None]
    matrix /= np.linalg.norm(matrix, axis=1)[:, None]
    return matrix


def rows_around(rng: np.random.Generator, n: int, m: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rows that a point inside satisfies with some slack, about half of them violated by the target; and the point."""
    matrix, inside = _hand_rows(rng, n, m), rng.normal(size=n)
    return matrix, matrix @ inside - rng.exponential(0.3, size=m), inside + 2.0 * rng.normal(size=n), inside


def duplicates(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target, _ = rows_around(rng, n, m)
    half = m // 2
    matrix[half : 2 * half], rhs[half : 2 * half] = matrix[:half], rhs[:half]
    return matrix, rhs, target


def _rank_one(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, _, target, inside = rows_around(rng, n, m)
    matrix = np.outer(rng.uniform(0.1, 2.0, size=m), matrix[0])
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


def _boundary(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, _, inside = rows_around(rng, n, m)
    # The target is feasible, and several rows hold there with equality: nothing is to be done.
    touching = rng.random(m) < 0.2
    touching[0] = True
    return matrix, np.where(touching, matrix @ inside, rhs), inside


def _scaled(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target, _ = rows_around(rng, n, m)
    factor = 10.0 ** rng.uniform(-6.0, 6.0, size=m)
    return matrix * factor[:, None], rhs * factor, target


def _mixed_units(rng: np.random.Generator, n: int, m: int) -> Rows:
    matrix, rhs, target, _ = rows_around(rng, n, m)
    # As if some variables were in metres and others in millimetres or milliradians.
    unit = np.where(np.arange(n) % 3 == 0, 1e3, np.where(np.arange(n) % 3 == 1, 1.0, 1e-1))
    return matrix / unit, rhs, target * unit


def _vertex(rng: np.random.Generator, n: int, m: int) -> Rows:
    # All rows meet in one point and push: more than n are active there.
    matrix, _, _, tip = rows_around(rng, n, m)
    matrix *= np.where(matrix @ matrix[0] < 0.0, -1.0, 1.0)[:, None]
    return matrix, matrix @ tip, tip - matrix.T @ rng.exponential(1.0, size=m)


def _contradiction(gap: float) -> Maker:
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


FEASIBLE_SETS: dict[str, Maker] = {
    "duplicate rows": duplicates,
    "all rows of rank 1": _rank_one,
    "pairs parallel to 1e-9": parallel(1e-9),
    "pairs parallel to 1e-5": parallel(1e-5),
    "zero rows, rhs 0": zero_rows(0.0),
    "zero rows, rhs -1": zero_rows(-1.0),
    "start on the boundary": _boundary,
    "rows scaled 1e-6 to 1e6": _scaled,
    "mm and rad mixed": _mixed_units,
    "more than n active": _vertex,
}

INFEASIBLE_SETS: dict[str, Maker] = {"infeasible by 1": _contradiction(1.0), "infeasible by 1e-9": _contradiction(1e-9)}


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


def outcome_of(status: int, program: Program, work: Any) -> Outcome:
    multiplier = np.zeros(program.rows)
    np.add.at(multiplier, work.active[: work.counts[0]], work.multiplier[: work.counts[0]])
    return Outcome(status, work.x[: program.variables].copy(), multiplier, work)


def solve_program(program: Program, guess: Iterable[int] = ()) -> Outcome:
    work = rubbish_work(program.variables, program.rows)
    guesses = np.array([*guess, 0], dtype=np.int64)
    rows, limits = kernel_rows(program), (program.tolerance, program.relaxation)
    status = active_set.solve(program.variables, rows, program.target, *limits, guesses, guesses.size - 1, work)
    return outcome_of(status, program, work)


def kernel_rows(program: Program) -> row_scan.Rows:
    """The rows as the kernels take them."""
    return row_scan.Rows(len(program.common), program.common, program.block, program.rhs, *program.groups)


def rubbish_work(variables: int, rows: int) -> Any:
    """A workspace in which nothing may matter."""
    work = active_set.new_work(variables, rows)
    for name in work.dtype.names:
        work[name].fill(-7 if work[name].dtype == np.int64 else np.nan)
    return work
