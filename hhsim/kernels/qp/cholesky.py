"""Small dense symmetric positive definite systems, A x = b by A = Uᵀ U.

Row-oriented and right-looking: every inner loop runs along a contiguous row, so that it uses the vector unit in strict
arithmetic, and the sums are taken in the same order on every machine.
"""

import math

import numpy as np

from hhsim.kernels.jit import Array, jit_inline

NOT_POSITIVE = 1
"""Status: a pivot is not positive and finite; the matrix is not positive definite to working precision."""


@jit_inline
def factorise(matrix: Array, count: int) -> int:
    """Replace the upper triangle of the leading `count` rows by U, the lower one unread; return 0, or NOT_POSITIVE."""
    for k in range(count):
        pivot = matrix[k, k]
        if not 0.0 < pivot < np.inf:
            return NOT_POSITIVE
        scale = 1.0 / math.sqrt(pivot)
        for j in range(k, count):
            matrix[k, j] *= scale
        for i in range(k + 1, count):
            factor = matrix[k, i]
            if factor == 0.0:
                continue
            for j in range(i, count):
                matrix[i, j] -= factor * matrix[k, j]
    return 0


@jit_inline
def solve_factorised(factor: Array, count: int, vector: Array) -> None:
    """Replace b, the leading `count` numbers of `vector`, by the solution of Uᵀ U x = b."""
    for k in range(count):
        value = vector[k] / factor[k, k]
        vector[k] = value
        for j in range(k + 1, count):
            vector[j] -= value * factor[k, j]
    for k in range(count - 1, -1, -1):
        value = vector[k]
        for j in range(k + 1, count):
            value -= factor[k, j] * vector[j]
        vector[k] = value / factor[k, k]
