"""Rotations as unit quaternions (w, x, y, z) and rotation vectors.

The solver moves a pose by a *left* increment: a rotation vector δφ [rad] in the world frame turns orientation q into
exp(δφ) q. Euler angles, which the paper uses, lock at β = ±90° and weigh the axes unequally.
"""

import math

from hhsim.kernels.elementary import arc_tangent, hypotenuse, sine_cosine
from hhsim.kernels.jit import Array, jit_inline

SMALL_ANGLE = 1e-8
"""Angle [rad] below which the series of sin(x)/x to second order is exact in double precision."""

JACOBI_SWEEPS = 10
"""Sweeps of rotations after which a symmetric matrix of three rows is diagonal: five are enough in practice."""


@jit_inline
def quaternion_to_matrix(quaternion: Array, matrix_out: Array) -> None:
    """Compute the rotation matrix, shape (3, 3), of a unit quaternion, shape (4,)."""
    w, x, y, z = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    matrix_out[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrix_out[0, 1] = 2.0 * (x * y - w * z)
    matrix_out[0, 2] = 2.0 * (x * z + w * y)
    matrix_out[1, 0] = 2.0 * (x * y + w * z)
    matrix_out[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrix_out[1, 2] = 2.0 * (y * z - w * x)
    matrix_out[2, 0] = 2.0 * (x * z - w * y)
    matrix_out[2, 1] = 2.0 * (y * z + w * x)
    matrix_out[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@jit_inline
def turned(matrix: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the product of a matrix, shape (3, 3), and a vector."""
    return (
        matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z,
        matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z,
        matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z,
    )


@jit_inline
def turned_back(matrix: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the product of a transposed matrix, shape (3, 3), and a vector."""
    return (
        matrix[0, 0] * x + matrix[1, 0] * y + matrix[2, 0] * z,
        matrix[0, 1] * x + matrix[1, 1] * y + matrix[2, 1] * z,
        matrix[0, 2] * x + matrix[1, 2] * y + matrix[2, 2] * z,
    )


@jit_inline
def quaternion_product(
    aw: float, ax: float, ay: float, az: float, bw: float, bx: float, by: float, bz: float
) -> tuple[float, float, float, float]:
    """Multiply two quaternions (w, x, y, z)."""
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@jit_inline
def write_unit_quaternion(quaternion_out: Array, w: float, x: float, y: float, z: float) -> None:
    """Write a normalised quaternion."""
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    quaternion_out[0], quaternion_out[1] = w * scale, x * scale
    quaternion_out[2], quaternion_out[3] = y * scale, z * scale


@jit_inline
def rotation_vector_between(source: Array, target: Array, vector_out: Array) -> None:
    """Compute the shorter rotation vector v [rad], world, with exp(v) source = target, quaternions of shape (4,)."""
    w, x, y, z = quaternion_product(
        target[0], target[1], target[2], target[3], source[0], -source[1], -source[2], -source[3]
    )
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if sine < SMALL_ANGLE else 2.0 * arc_tangent(sine, w) / sine
    vector_out[0], vector_out[1], vector_out[2] = scale * x, scale * y, scale * z


@jit_inline
def rotate_quaternion(quaternion: Array, vx: float, vy: float, vz: float, quaternion_out: Array) -> None:
    """Compute exp(v) quaternion, normalised: the left increment by rotation vector v [rad], world frame."""
    angle = math.sqrt(vx * vx + vy * vy + vz * vz)
    half_sinc, cosine = 0.5, 1.0
    if not angle < SMALL_ANGLE:
        half_sinc, cosine = sine_cosine(0.5 * angle)
        half_sinc /= angle
    ax, ay, az = half_sinc * vx, half_sinc * vy, half_sinc * vz
    w, x, y, z = quaternion_product(cosine, ax, ay, az, quaternion[0], quaternion[1], quaternion[2], quaternion[3])
    write_unit_quaternion(quaternion_out, w, x, y, z)


@jit_inline
def diagonalise(matrix: Array, axes: Array) -> None:
    """Diagonalise a symmetric matrix (3, 3), with eigenvectors, by Jacobi rotations (Golub & Van Loan, section 8.5)."""
    for _ in range(JACOBI_SWEEPS):
        for p in range(2):
            for q in range(p + 1, 3):
                off = matrix[p, q]
                if off == 0.0:
                    continue
                slope = (matrix[q, q] - matrix[p, p]) / (2.0 * off)
                t = math.copysign(1.0 / (abs(slope) + hypotenuse(1.0, slope)), slope)
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                for k in range(3):
                    a, b = matrix[k, p], matrix[k, q]
                    matrix[k, p], matrix[k, q] = c * a - s * b, s * a + c * b
                for k in range(3):
                    a, b = matrix[p, k], matrix[q, k]
                    matrix[p, k], matrix[q, k] = c * a - s * b, s * a + c * b
                matrix[p, q] = matrix[q, p] = 0.0
                for k in range(3):
                    a, b = axes[k, p], axes[k, q]
                    axes[k, p], axes[k, q] = c * a - s * b, s * a + c * b
