"""Rotations as arrays of unit quaternions (w, x, y, z)."""

import numpy as np
from numpy.typing import ArrayLike

from hhsim.arrays import FloatArray
from hhsim.reproducible import arc_tangent, sine_and_cosine

SMALL_ANGLE = 1e-9
"""Angle [rad] below which its sine is the angle."""


def quaternion(vector: ArrayLike) -> FloatArray:
    """Return unit quaternions (w, x, y, z), shape (..., 4), of rotation vectors [rad], shape (..., 3)."""
    turns = np.asarray(vector, np.float64)
    half = 0.5 * np.linalg.norm(turns, axis=-1, keepdims=True)
    sine, cosine = sine_and_cosine(half)
    small = half < SMALL_ANGLE
    return np.concatenate([cosine, 0.5 * np.where(small, 1.0, sine / np.where(small, 1.0, half)) * turns], axis=-1)


def rotation_vector(quaternions: ArrayLike) -> FloatArray:
    """Return the shortest rotation vectors [rad], shape (..., 3), of unit quaternions (w, x, y, z), shape (..., 4)."""
    q = np.asarray(quaternions, np.float64)
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    small = sine < 1e-12
    scale = np.where(small, 2.0, 2.0 * arc_tangent(sine, q[..., :1]) / np.where(small, 1.0, sine))
    return np.asarray(scale * q[..., 1:])


def quaternion_product(first: ArrayLike, second: ArrayLike) -> FloatArray:
    """Return the rotation by `second` and then by `first`, shapes (..., 4)."""
    aw, ax, ay, az = np.moveaxis(np.asarray(first, np.float64), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(second, np.float64), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def conjugate(quaternions: ArrayLike) -> FloatArray:
    """Return the inverse of unit quaternions, shape (..., 4)."""
    return np.asarray(np.asarray(quaternions, np.float64) * [1.0, -1.0, -1.0, -1.0])


def rotation_matrix(quaternions: ArrayLike) -> FloatArray:
    """Return matrices, shape (..., 3, 3), of unit quaternions (w, x, y, z), shape (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternions, np.float64), -1, 0)
    entries = [
        *(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        *(2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        *(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    ]
    return np.stack(entries, axis=-1).reshape(*np.shape(w), 3, 3)


def quaternion_from_matrix(matrix: ArrayLike) -> FloatArray:
    """Return unit quaternions (w, x, y, z), w >= 0, shape (..., 4), of rotation matrices, (..., 3, 3); NaN of NaN."""
    m = np.moveaxis(np.asarray(matrix, np.float64), (-2, -1), (0, 1))
    wx, wy, wz = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    xy, xz, yz = m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1]
    rows = np.array(
        [
            [1.0 + m[0, 0] + m[1, 1] + m[2, 2], wx, wy, wz],
            [wx, 1.0 + m[0, 0] - m[1, 1] - m[2, 2], xy, xz],
            [wy, xy, 1.0 - m[0, 0] + m[1, 1] - m[2, 2], yz],
            [wz, xz, yz, 1.0 - m[0, 0] - m[1, 1] + m[2, 2]],
        ]
    )
    # All four rows are the quaternion times one of its components; the largest loses no digits.
    squares = np.nan_to_num(np.stack([rows[k, k] for k in range(4)]), nan=-1.0)
    row = np.moveaxis(np.take_along_axis(rows, np.argmax(squares, axis=0)[None, None], axis=0)[0], 0, -1)
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.ascontiguousarray(np.where(unit[..., :1] < 0.0, -unit, unit))
