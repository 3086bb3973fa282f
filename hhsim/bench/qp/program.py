"""Programs in the kernels' layout, and checks of an answer computed from the program alone.

    minimise ½ |x - x₀|²   subject to   a_i · x >= b_i

in the conditioned variables x = √G δ [√J], see `hhsim.kernels.qp.active_set`. Residuals are of rows of length 1 over
the program's `size`: 1e-9 is a billionth of the numbers in the program.
"""

from dataclasses import dataclass, replace

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.solver.qp import QpProblem

CERTIFIED_RADIUS = 1e3
"""Least radius without a feasible point, in sizes of the program, that proves infeasibility: rounding limits it to
about a million for rows that contradict each other by 1e-9."""


@dataclass(frozen=True)
class Program:
    """One program.

    Attributes:
        kind: `coupled`, `palm`, `palm+fingers` or `finger`; or the name of a size or of a degenerate set.
        common: Columns that all rows share, shape (0 or 6, m).
        block: Three more columns, shape (3, m), of the variables of the row's group.
        rhs: b, shape (m,).
        groups: First row of each group, the row after its last, and the first variable of its block (-1 for none);
            shape (3, groups).
        target: x₀, shape (n,) [√J].
        tolerance: Violation that counts as satisfied [√J].
        relaxation: Largest distance by which contradicting rows are moved back [√J].
        guess: Rows expected to be active.
        source: Scene that it is from.
        tick: Tick of the scene's motion; -1 without one.
        step: Linearisation of that tick, from 0.
    """

    kind: str
    common: FloatArray
    block: FloatArray
    rhs: FloatArray
    groups: IntArray
    target: FloatArray
    tolerance: float
    relaxation: float
    guess: IntArray
    source: str = ""
    tick: int = -1
    step: int = -1

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

    @property
    def size(self) -> float:
        """Larger of |x₀| and the largest |b_i| / |a_i| [√J]; 1 if all are zero."""
        norm = np.linalg.norm(self.matrix, axis=1)
        apart = np.abs(self.rhs) / np.where(norm > 0.0, norm, np.inf)
        size = max(float(np.linalg.norm(self.target)), float(apart.max(initial=0.0)))
        return size if size > 0.0 else 1.0

    @property
    def problem(self) -> QpProblem:
        """Program as plain matrices, with a stiffness of 1."""
        return QpProblem(np.ones(self.variables), self.matrix, self.rhs, self.target)

    def unit_rows(self) -> tuple[FloatArray, FloatArray]:
        """Return rows of length 1, shape (m, n), zero rows as they are, and the lengths they had, shape (m,)."""
        return self.problem.conditioned()[1:]

    def unguessed(self) -> "Program":
        """Return the program without its guess."""
        return replace(self, guess=self.guess[:0])


def residual(program: Program, x: FloatArray, multiplier: FloatArray, moved_back: float = 0.0) -> float:
    """Return the KKT residual of a solution x (n,), in sizes of the program; infinite where it is not a number.

    Args:
        multiplier: Of the rows as given, shape (m,).
        moved_back: Distance by which every row is moved back before the check [√J].
    """
    problem = program.problem
    if moved_back:
        problem = replace(problem, rhs=program.rhs - moved_back * program.unit_rows()[1])
    with np.errstate(invalid="ignore", over="ignore"):
        found = problem.kkt_residual(x, multiplier) / program.size
    return found if found == found else np.inf


def violation(program: Program, x: FloatArray) -> float:
    """Return the largest violation of a row by x (n,), in sizes of the program."""
    matrix, norm = program.unit_rows()
    return float(np.max(program.rhs / norm - matrix @ x, initial=0.0)) / program.size


def certified_radius(program: Program, certificate: FloatArray) -> float:
    """Return the radius about the origin in which no x satisfies the rows, in sizes of the program; 0 without proof.

    For y >= 0 and any x of length ρ, yᵀ (A x - b) <= |yᵀ A| ρ - yᵀ b: negative for ρ < yᵀ b / |yᵀ A|. Sums are taken in
    extended precision; y belongs to the normalised rows.
    """
    matrix, norm = program.unit_rows()
    y = np.asarray(certificate, dtype=np.longdouble)
    if not np.isfinite(y).all() or y.min(initial=0.0) < 0.0:
        return 0.0
    gap = float(y @ (program.rhs.astype(np.longdouble) / norm))
    length = float(np.linalg.norm((y @ matrix.astype(np.longdouble)).astype(np.float64)))
    if gap <= 0.0:
        return 0.0
    return gap / length / program.size if length > 0.0 else np.inf
