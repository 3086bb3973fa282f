"""Products, lengths and angles of arrays, with the same bits on every machine.

numpy leaves matrix products and `linalg` to a BLAS, and sines to a library, which both choose their code by the
processor; what enters a tick must not depend on it. These functions take sums in a fixed order, of one rounded product
after the other. `np.linalg.norm` with an axis does the same and is used as it is.
"""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray


def matmul(first: ArrayLike, second: ArrayLike) -> FloatArray:
    """Return `first @ second`, shapes (..., n) and (n,) or (..., n) and (n, m), for a small n."""
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    terms = [a[..., k] * b[k] if b.ndim == 1 else a[..., k, None] * b[k] for k in range(len(b))]
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return np.asarray(total)


def dot(first: ArrayLike, second: ArrayLike) -> FloatArray:
    """Return the sums of products along the last axis, shape (...)."""
    return np.asarray((np.asarray(first, np.float64) * np.asarray(second, np.float64)).sum(axis=-1))


def norm(vectors: ArrayLike) -> FloatArray:
    """Return the lengths of vectors, shape (..., n); shape (...)."""
    return np.asarray(np.linalg.norm(np.asarray(vectors, np.float64), axis=-1))


def across(direction: FloatArray) -> FloatArray:
    """Return two unit vectors across a unit direction and each other, shape (2, 3)."""
    least = np.eye(3)[int(np.argmin(np.abs(direction)))]
    first = np.cross(direction, least)
    first /= norm(first)
    return np.stack([first, np.cross(direction, first)])


def sine_and_cosine(angle: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return sines and cosines of angles [rad], of their shape."""
    from hhsim.kernels.arithmetic import sines_and_cosines

    angles = np.asarray(angle, np.float64)
    sine, cosine = np.empty(angles.size), np.empty(angles.size)
    sines_and_cosines(angles.ravel(), sine, cosine)
    return sine.reshape(angles.shape), cosine.reshape(angles.shape)


def arc_tangent(y: ArrayLike, x: ArrayLike) -> FloatArray:
    """Return the angles [rad] of vectors (x, y), of the shape that both broadcast to."""
    from hhsim.kernels.arithmetic import arc_tangents

    ordinate, abscissa = np.broadcast_arrays(np.asarray(y, np.float64), np.asarray(x, np.float64))
    angle = np.empty(ordinate.size)
    arc_tangents(ordinate.flatten(), abscissa.flatten(), angle)
    return angle.reshape(ordinate.shape)


def exponential(x: ArrayLike) -> FloatArray:
    """Return e^x, of the shape of x."""
    from hhsim.kernels.arithmetic import exponentials

    values = np.asarray(x, np.float64)
    found = np.empty(values.size)
    exponentials(values.flatten(), found)
    return found.reshape(values.shape)


def principal_axes(matrix: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues, ascending, shape (3,), and right-handed unit eigenvectors as columns, of a symmetric matrix.

    The largest component of the first two eigenvectors is positive.
    """
    from hhsim.kernels.rotation import diagonalise

    work, axes = np.array(matrix, np.float64), np.eye(3)
    diagonalise(work, axes)
    value = np.diag(work)
    order = np.argsort(value, kind="stable")
    axes = axes[:, order]
    axes[:, :2] *= np.where(axes[np.abs(axes).argmax(axis=0), range(3)] < 0.0, -1.0, 1.0)[:2]
    # The cross product: numpy's own takes ten times as long for single vectors.
    a, b = axes[:, 0], axes[:, 1]
    axes[:, 2] = a[[1, 2, 0]] * b[[2, 0, 1]] - a[[2, 0, 1]] * b[[1, 2, 0]]
    return value[order], np.ascontiguousarray(axes)
