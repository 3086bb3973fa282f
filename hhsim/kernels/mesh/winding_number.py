"""Generalized winding number: how often a surface surrounds a point, closed or not.

The number is the signed solid angle of all triangles over 4π (Jacobson, Kavan, Sorkine-Hornung 2013, "Robust
inside-outside segmentation using generalized winding numbers"); 1 inside and 0 outside a closed surface, in between
near a hole, 2 or −1 where parts overlap or are inside out.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import jit, jit_inline
from hhsim.kernels.triangle import Triangle

SMALL = 1.0e-100


@jit_inline
def turned_by(
    x: float, y: float, z: float, triangle: Triangle, real: float, imaginary: float, turns: int
) -> tuple[float, float, int]:
    """Multiply a product of arguments by that of one triangle, seen from a point; see `winding_numbers`."""
    ax, ay, az = triangle.ax - x, triangle.ay - y, triangle.az - z
    bx, by, bz = triangle.bx - x, triangle.by - y, triangle.bz - z
    cx, cy, cz = triangle.cx - x, triangle.cy - y, triangle.cz - z
    n = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    a = math.sqrt(ax * ax + ay * ay + az * az)
    b = math.sqrt(bx * bx + by * by + bz * bz)
    c = math.sqrt(cx * cx + cy * cy + cz * cz)
    ab = ax * bx + ay * by + az * bz
    bc = bx * cx + by * cy + bz * cz
    ca = cx * ax + cy * ay + cz * az
    d = a * b * c + ab * c + bc * a + ca * b
    # Lengths cubed: only their ratio counts, and a product of many would leave the range of a float.
    size = abs(n) + abs(d)
    if n == 0.0 or size < SMALL:
        return real, imaginary, turns
    n /= size
    d /= size
    next_real = real * d - imaginary * n
    next_imaginary = real * n + imaginary * d
    if n > 0.0 and imaginary >= 0.0 and next_imaginary < 0.0:
        turns += 1
    elif n < 0.0 and imaginary < 0.0 and next_imaginary >= 0.0:
        turns -= 1
    weight = abs(next_real) + abs(next_imaginary)
    if weight < 0.01:
        next_real /= weight
        next_imaginary /= weight
    return next_real, next_imaginary, turns


@jit
def winding_numbers(
    triangles: NDArray[np.float64], points: NDArray[np.float64], winding_out: NDArray[np.float64]
) -> None:
    """Sum the exact solid angles of all triangles at each point.

    The solid angle Ω of a triangle with corners a, b, c about the point is 2·arg(d + i·n), with n = a·(b × c) and
    d = |a||b||c| + (a·b)|c| + (b·c)|a| + (c·a)|b| (Van Oosterom and Strackee 1983). The arguments add up as the complex
    numbers multiply; one argument is within ±π, so a product that crosses the negative real axis has gone round once.
    That costs one arctangent a point instead of one a triangle. A point on a triangle's edge, or a triangle without
    area seen from its own line, adds nothing.

    Args:
        triangles: Corners [m], shape (F, 3, 3).
        points: Where to evaluate [m], shape (n, 3).
        winding_out: Winding number at each point [-], shape (n,).
    """
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        real, imaginary = 1.0, 0.0
        turns = 0
        for k in range(triangles.shape[0]):
            t = triangles[k]
            corners = Triangle(t[0, 0], t[0, 1], t[0, 2], t[1, 0], t[1, 1], t[1, 2], t[2, 0], t[2, 1], t[2, 2])
            real, imaginary, turns = turned_by(px, py, pz, corners, real, imaginary, turns)
        winding_out[i] = (math.atan2(imaginary, real) + 2.0 * math.pi * turns) / (2.0 * math.pi)
