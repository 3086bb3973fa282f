"""Programs in the kernels' own layout, apart from the tick that built them.

    minimise ½ |x - x₀|²   subject to   a_i · x >= b_i

in the conditioned variables x = √G δ [√J], see `hhsim.kernels.qp.active_set`.
"""

from dataclasses import dataclass, replace

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.solver.qp import QpProblem


@dataclass(frozen=True)
class Program:
    """One program.

    Attributes:
        kind: What it is of: `coupled`, `palm`, `palm+fingers`, `finger`; or the name of a size or of a degenerate set.
        common: Columns that all rows share, shape (0 or 6, m).
        block: Three more, shape (3, m); which variables they stand for is the group's.
        rhs: b, shape (m,).
        groups: First row of each group, the row after its last, and the first variable of its block (-1 for none);
            shape (3, groups).
        target: x₀, shape (n,) [√J].
        tolerance: Violation that counts as satisfied [√J].
        relaxation: What contradicting rows may be moved back by [√J].
        guess: Rows expected to be active.
        source: Where it was found.
        tick: Of the motion there; -1 where it is of none.
        step: Which linearisation of that tick, from 0; programs of one step are solved one after the other.
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
        """Their number n."""
        return self.target.size

    @property
    def rows(self) -> int:
        """Their number m."""
        return self.rhs.size

    @property
    def matrix(self) -> FloatArray:
        """The rows a_i, shape (m, n)."""
        dense = np.zeros((self.rows, self.variables))
        dense[:, : len(self.common)] = self.common.T
        for start, stop, first in self.groups.T:
            if first >= 0:
                dense[start:stop, first : first + 3] = self.block[:, start:stop].T
        return dense

    @property
    def size(self) -> float:
        """Size of the numbers in it [√J]: the larger of |x₀| and the largest |b_i| / |a_i|; 1 where all are zero."""
        norm = np.linalg.norm(self.matrix, axis=1)
        apart = np.abs(self.rhs) / np.where(norm > 0.0, norm, np.inf)
        size = max(float(np.linalg.norm(self.target)), float(apart.max(initial=0.0)))
        return size if size > 0.0 else 1.0

    @property
    def problem(self) -> QpProblem:
        """The program as plain matrices, with a stiffness of 1."""
        return QpProblem(np.ones(self.variables), self.matrix, self.rhs, self.target)

    def unit_rows(self) -> tuple[FloatArray, FloatArray]:
        """Return rows of length 1, shape (m, n), zero rows as they are, and the lengths they had, shape (m,)."""
        return self.problem.conditioned()[1:]

    def unguessed(self) -> "Program":
        """The same, to be solved from nothing."""
        return replace(self, guess=self.guess[:0])
