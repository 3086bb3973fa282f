"""Generalized winding number: how often a surface surrounds a point, closed or not.

The number is the signed solid angle of all triangles over 4π (Jacobson, Kavan, Sorkine-Hornung 2013, "Robust
inside-outside segmentation using generalized winding numbers"); 1 inside and 0 outside a closed surface, in between
near a hole, 2 or −1 where parts overlap or are inside out.
"""

import math

import numpy as np
from numpy.typing import NDArray

from .jit import jit

SMALL = 1.0e-100


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
            ax, ay, az = triangles[k, 0, 0] - px, triangles[k, 0, 1] - py, triangles[k, 0, 2] - pz
            bx, by, bz = triangles[k, 1, 0] - px, triangles[k, 1, 1] - py, triangles[k, 1, 2] - pz
            cx, cy, cz = triangles[k, 2, 0] - px, triangles[k, 2, 1] - py, triangles[k, 2, 2] - pz
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
                continue
            n /= size
            d /= size
            next_real = real * d - imaginary * n
            next_imaginary = real * n + imaginary * d
            if n > 0.0 and imaginary >= 0.0 and next_imaginary < 0.0:
                turns += 1
            elif n < 0.0 and imaginary < 0.0 and next_imaginary >= 0.0:
                turns -= 1
            real, imaginary = next_real, next_imaginary
            weight = abs(real) + abs(imaginary)
            if weight < 0.01:
                real /= weight
                imaginary /= weight
        winding_out[i] = (math.atan2(imaginary, real) + 2.0 * math.pi * turns) / (2.0 * math.pi)
