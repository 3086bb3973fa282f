"""Least-distance program: the point nearest to the origin that satisfies linear inequalities.

It is solved as a non-negative least-squares problem (Lawson & Hanson, Solving Least Squares Problems, 1974, chapter
23), which any number of redundant rows leaves unharmed.
"""

import numpy as np

from hhsim.arrays import FloatArray

INFEASIBLE = 1e-10
"""Residual up to which the rows count as contradictory: a feasible point is nearer than the inverse of its root."""


def nearest_to_origin(rows: FloatArray, bounds: FloatArray) -> FloatArray | None:
    """Compute the shortest x with rows · x ≥ bounds, of shapes (m, n) and (m,); None if there is none."""
    from scipy.optimize import nnls

    matrix, target = np.vstack([rows.T, bounds]), np.append(np.zeros(rows.shape[1]), 1.0)
    try:
        multiplier, _ = nnls(matrix, target)
    except RuntimeError:
        # It has used up its iterations.
        return None
    residual = matrix @ multiplier - target
    # A residual of zero is Farkas' proof that no x satisfies all rows.
    return None if residual[-1] > -INFEASIBLE else -residual[:-1] / residual[-1]
