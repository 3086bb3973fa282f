"""Whether an answer to a program is right, computed from the program alone and not from what a solver says of itself.

All residuals are in conditioned variables with rows of length 1, [√J], divided by the program's `size`: a residual of
1e-9 is a billionth of the numbers that the program is made of.
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.qp.program import Program

CERTIFIED_RADIUS = 1e3
"""A certificate is a proof where no point nearer than this many sizes of the program could satisfy the rows.

Its sums are rounded, so that rows which contradict each other by 1e-9 are told apart from rows which meet far away to
about a million sizes.
"""


class Residuals(NamedTuple):
    """How far an answer is from satisfying each of the optimality conditions (Karush, Kuhn and Tucker).

    Attributes:
        primal: Largest violation of a row.
        dual: Largest negative multiplier.
        stationarity: Largest component of x - x₀ - Aᵀ λ.
        complementarity: Largest of the smaller of a row's slack and its multiplier.
    """

    primal: float
    dual: float
    stationarity: float
    complementarity: float

    @property
    def largest(self) -> float:
        """Of the four; infinite where one is NaN."""
        return max(self) if all(value == value for value in self) else np.inf


def residuals(program: Program, x: FloatArray, multiplier: FloatArray, moved_back: float = 0.0) -> Residuals:
    """Of a solution x (n,) with multipliers (m,) of the rows as given; `moved_back` is what the rows give [√J]."""
    matrix, norm = program.unit_rows()
    size = program.size
    with np.errstate(invalid="ignore", over="ignore"):
        slack = (matrix @ x - program.rhs / norm + moved_back) / size
        push = multiplier * norm / size
        balance = (x - program.target) / size - matrix.T @ push
    # A row of zeros can only be left alone or be the certificate of a contradiction.
    rows = matrix.any(axis=1)
    parts = (-slack, -push, np.abs(balance), np.minimum(slack, push)[rows])
    return Residuals(*(float(part.max(initial=0.0)) for part in parts))


def certified_radius(program: Program, certificate: FloatArray) -> float:
    """How far from the origin no x can satisfy the rows, in sizes of the program; 0 where nothing is proved.

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
