"""Check an answer to a program, computed from the program alone and not from what a solver says of itself.

All residuals are in conditioned variables with rows of length 1, [√J], divided by the program's `size`: a residual of
1e-9 is a billionth of the numbers that the program is made of.
"""

from dataclasses import replace

import numpy as np

from hhsim.arrays import FloatArray
from hhsim.bench.qp.program import Program

CERTIFIED_RADIUS = 1e3
"""A certificate is a proof where no point nearer than this many sizes of the program could satisfy the rows.

Its sums are rounded, so that rows which contradict each other by 1e-9 are told apart from rows which meet far away to
about a million sizes.
"""


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
