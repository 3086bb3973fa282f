"""Rotations as unit quaternions (w, x, y, z) and rotation vectors.

The solver moves a pose by a *left* increment: a rotation vector δφ [rad] in the world frame turns orientation q into
exp(δφ) q. Euler angles, which the paper uses, lock at β = ±90° and weigh the axes unequally.
"""

import math

from hhsim.kernels.jit import Array, jit

SMALL_ANGLE = 1e-8
"""Below this angle [rad] the series of sin(x)/x to second order is exact in double precision."""


@jit
def quaternion_to_matrix(quaternion: Array, matrix_out: Array) -> None:
    """Rotation matrix, shape (3, 3), of a unit quaternion, shape (4,)."""
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


@jit
def rotation_vector_between(source: Array, target: Array, vector_out: Array) -> None:
    """Rotation vector v [rad], world frame, with exp(v) source = target, the short way round.

    Quaternions of shape (4,).
    """
    # target * conjugate(source)
    aw, ax, ay, az = target[0], target[1], target[2], target[3]
    bw, bx, by, bz = source[0], -source[1], -source[2], -source[3]
    w = aw * bw - ax * bx - ay * by - az * bz
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if sine < SMALL_ANGLE else 2.0 * math.atan2(sine, w) / sine
    vector_out[0] = scale * x
    vector_out[1] = scale * y
    vector_out[2] = scale * z


@jit
def rotate_quaternion(quaternion: Array, vx: float, vy: float, vz: float, quaternion_out: Array) -> None:
    """exp(v) quaternion, normalised: the left increment by rotation vector v [rad], world frame."""
    angle = math.sqrt(vx * vx + vy * vy + vz * vz)
    if angle < SMALL_ANGLE:
        half_sinc = 0.5
        aw = 1.0
    else:
        half_sinc = math.sin(0.5 * angle) / angle
        aw = math.cos(0.5 * angle)
    ax, ay, az = half_sinc * vx, half_sinc * vy, half_sinc * vz
    bw, bx, by, bz = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    w = aw * bw - ax * bx - ay * by - az * bz
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    scale = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    quaternion_out[0] = w * scale
    quaternion_out[1] = x * scale
    quaternion_out[2] = y * scale
    quaternion_out[3] = z * scale
