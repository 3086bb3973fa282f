"""Rotations: unit quaternions (w, x, y, z), rotation vectors [rad], and the Euler angles of the paper.

The solver moves a pose by a *left* increment: a rotation vector δφ [rad] in the world frame turns orientation q into
exp(δφ) q. Euler angles, which the paper uses, lock at β = ±90° and weigh the axes unequally.

Euler angles as in the paper: R = R_z(γ) R_y(β) R_x(α), its R_L^W (Section IV-B1).

Arrays hold (α, β, γ) [rad], about X, Y and Z. At β = ±90° they lock: α and γ turn about the same axis.
"""

import math

from hhsim.kernels.arithmetic import arc_tangent, hypotenuse, sine_cosine
from hhsim.kernels.jit import Array, jit, jit_inline

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


LOCKED = 1e-9
"""Cosine of β below which only the sum or the difference of α and γ is defined."""


@jit
def euler_quaternion(euler: Array, quaternion_out: Array) -> None:
    """Compute the unit quaternion (w, x, y, z), shape (4,), of angles, shape (3,)."""
    sa, ca = sine_cosine(0.5 * euler[0])
    sb, cb = sine_cosine(0.5 * euler[1])
    sc, cc = sine_cosine(0.5 * euler[2])
    w = cc * cb * ca + sc * sb * sa
    x = cc * cb * sa - sc * sb * ca
    y = cc * sb * ca + sc * cb * sa
    z = sc * cb * ca - cc * sb * sa
    write_unit_quaternion(quaternion_out, w, x, y, z)


@jit
def euler_axes(euler: Array, axes_out: Array) -> None:
    """Compute the world axes about which a change of α, β and γ turns the body, rows of shape (3, 3)."""
    sb, cb = sine_cosine(euler[1])
    sc, cc = sine_cosine(euler[2])
    axes_out[0, 0], axes_out[0, 1], axes_out[0, 2] = cc * cb, sc * cb, -sb
    axes_out[1, 0], axes_out[1, 1], axes_out[1, 2] = -sc, cc, 0.0
    axes_out[2, 0], axes_out[2, 1], axes_out[2, 2] = 0.0, 0.0, 1.0


@jit
def _unwrapped(angle: float, near: float) -> float:
    return angle + 2.0 * math.pi * math.floor((near - angle) / (2.0 * math.pi) + 0.5)


@jit
def nearest_euler(rotation: Array, near: Array, euler_out: Array) -> None:
    """Compute angles of a rotation matrix, shape (3, 3), of the branch nearest to the angles `near`, shape (3,).

    (α, β, γ) and (α + π, π - β, γ + π) are the same rotation, and each angle may be off by full turns: without this
    choice a hand that turns through β = 90° or γ = 180° would be sent all the way round.
    """
    cosine = hypotenuse(rotation[0, 0], rotation[1, 0])
    b = arc_tangent(-rotation[2, 0], cosine)
    if cosine > LOCKED:
        a = arc_tangent(rotation[2, 1], rotation[2, 2])
        c = arc_tangent(rotation[1, 0], rotation[0, 0])
    else:
        c = near[2]
        if b > 0.0:
            a = c + arc_tangent(rotation[0, 1], rotation[1, 1])
        else:
            a = arc_tangent(-rotation[0, 1], rotation[1, 1]) - c
    a0, b0, c0 = _unwrapped(a, near[0]), _unwrapped(b, near[1]), _unwrapped(c, near[2])
    a1 = _unwrapped(a + math.pi, near[0])
    b1 = _unwrapped(math.pi - b, near[1])
    c1 = _unwrapped(c + math.pi, near[2])
    first = (a0 - near[0]) ** 2 + (b0 - near[1]) ** 2 + (c0 - near[2]) ** 2
    second = (a1 - near[0]) ** 2 + (b1 - near[1]) ** 2 + (c1 - near[2]) ** 2
    if second < first:
        a0, b0, c0 = a1, b1, c1
    euler_out[0], euler_out[1], euler_out[2] = a0, b0, c0
