"""Euler angles as in the paper: R = R_z(γ) R_y(β) R_x(α), its R_L^W (Section IV-B1).

Arrays hold (α, β, γ) [rad], about X, Y and Z. At β = ±90° they lock: α and γ turn about the same axis.
"""

import math

from hhsim.kernels.elementary import arc_tangent, hypotenuse, sine_cosine
from hhsim.kernels.jit import Array, jit
from hhsim.kernels.rotation import write_unit_quaternion

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
