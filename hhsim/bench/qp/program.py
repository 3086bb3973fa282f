"""Program of a tick in the kernels' layout.

    minimise ½ |x - x₀|²   subject to   a_i · x >= b_i

in the conditioned variables x = √G δ [√J], see `hhsim.kernels.qp.active_set`.
"""

from dataclasses import dataclass

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.solver.qp import QpProblem


@dataclass(frozen=True)
class Program:
    """One program.

    Attributes:
        kind: `coupled`, `palm`, `palm+fingers` or `finger`.
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
