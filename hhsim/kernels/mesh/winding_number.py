"""Generalized winding number of a surface, closed or not.

It is the signed solid angle of all triangles over 4π (Jacobson, Kavan, Sorkine-Hornung 2013, "Robust inside-outside
segmentation using generalized winding numbers"): 1 inside and 0 outside a closed surface, in between near a hole, 2 or
−1 where pieces overlap or are inside out. Triangles far away count together, after Barill, Dickson, Schmidt, Levin and
Jacobson, "Fast winding numbers for soups and clouds" (2018): a node with triangles within R of its centre is expanded,
to second order, for points beyond `FAR`·R.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.elementary import arc_tangent
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating, jit_inline
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.triangle import Triangle, triangle_at

SMALL = 1.0e-100
FAR = 2.5
"""Distance [radii of the node] from which a node is expanded: right to 0.05, and to 0.01 on average."""


@jit_inline
def turned_by(
    x: float, y: float, z: float, triangle: Triangle, real: float, imaginary: float, turns: int
) -> tuple[float, float, int]:
    """Multiply a product of arguments by that of one triangle seen from a point; see `winding_numbers`."""
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
def winding_numbers(triangles: Array, points: Array, winding_out: Array) -> None:
    """Sum the exact solid angles of all triangles at each point.

    The solid angle Ω of a triangle with corners a, b, c about the point is 2·arg(d + i·n), with n = a·(b × c) and
    d = |a||b||c| + (a·b)|c| + (b·c)|a| + (c·a)|b| (Van Oosterom and Strackee 1983). The arguments add up as the complex
    numbers multiply; one argument is within ±π, so a product that crosses the negative real axis has gone round once.
    That costs one arctangent a point instead of one a triangle. A point on a triangle's edge, or a triangle without
    area seen from its own line, adds nothing.
    """
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        real, imaginary = 1.0, 0.0
        turns = 0
        for k in range(triangles.shape[0]):
            t = triangles[k]
            corners = Triangle(t[0, 0], t[0, 1], t[0, 2], t[1, 0], t[1, 1], t[1, 2], t[2, 0], t[2, 1], t[2, 2])
            real, imaginary, turns = turned_by(px, py, pz, corners, real, imaginary, turns)
        winding_out[i] = (arc_tangent(imaginary, real) + 2.0 * math.pi * turns) / (2.0 * math.pi)


class WindingMoments(NamedTuple):
    """Moments of the triangles under each node of a `MeshBvh`."""

    center: Array  # mean of the triangles by area [m], (N, 3)
    radius: Array  # of the sphere around it [m], (N,)
    moment: Array  # sums of area vectors n [m²] and of (centroid − center) n [m³] row by row, (N, 12)


def winding_moments(bvh: Any) -> WindingMoments:
    """Compute the moments for the nodes of a `MeshBvh`, which holds such moments itself."""
    nodes = len(bvh.start)
    moments = WindingMoments(np.empty((nodes, 3)), np.empty(nodes), np.empty((nodes, 12)))
    _sum_moments(bvh, moments)
    return moments


@jit_allocating
def _sum_moments(bvh: Any, moments: WindingMoments) -> None:
    area = np.empty(bvh.corner.shape[0])
    vector = np.empty((bvh.corner.shape[0], 3))
    middle = np.empty((bvh.corner.shape[0], 3))
    for i in range(bvh.corner.shape[0]):
        t = bvh.corner[i]
        ux, uy, uz = t[3] - t[0], t[4] - t[1], t[5] - t[2]
        vx, vy, vz = t[6] - t[0], t[7] - t[1], t[8] - t[2]
        vector[i, 0] = 0.5 * (uy * vz - uz * vy)
        vector[i, 1] = 0.5 * (uz * vx - ux * vz)
        vector[i, 2] = 0.5 * (ux * vy - uy * vx)
        area[i] = math.sqrt(vector[i, 0] ** 2 + vector[i, 1] ** 2 + vector[i, 2] ** 2)
        for k in range(3):
            middle[i, k] = (t[k] + t[k + 3] + t[k + 6]) / 3.0
    for node in range(bvh.start.shape[0]):
        first, last = bvh.start[node], bvh.end[node]
        total = 0.0
        center = moments.center[node]
        center[:] = 0.0
        for i in range(first, last):
            total += area[i]
            for k in range(3):
                center[k] += area[i] * middle[i, k]
        for k in range(3):
            center[k] = center[k] / total if total > 0.0 else middle[first, k]
        farthest2 = 0.0
        moment = moments.moment[node]
        moment[:] = 0.0
        for i in range(first, last):
            for v in range(0, 9, 3):
                dx = bvh.corner[i, v] - center[0]
                dy = bvh.corner[i, v + 1] - center[1]
                dz = bvh.corner[i, v + 2] - center[2]
                farthest2 = max(farthest2, dx * dx + dy * dy + dz * dz)
            for k in range(3):
                moment[k] += vector[i, k]
                for j in range(3):
                    moment[3 + 3 * j + k] += (middle[i, j] - center[j]) * vector[i, k]
        moments.radius[node] = math.sqrt(farthest2)


@jit
def winding_at(bvh: Any, moments: WindingMoments, x: float, y: float, z: float, stack: Indices) -> float:
    """Compute the winding number [-] at one point [m], with a stack of shape (STACK,)."""
    far = 0.0
    real, imaginary = 1.0, 0.0
    turns = 0
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        dx, dy, dz = moments.center[node, 0] - x, moments.center[node, 1] - y, moments.center[node, 2] - z
        d2 = dx * dx + dy * dy + dz * dz
        reach = FAR * moments.radius[node]
        if d2 > reach * reach and d2 > 0.0:
            m = moments.moment[node]
            inverse2 = 1.0 / d2
            inverse3 = inverse2 * math.sqrt(inverse2)
            first = m[0] * dx + m[1] * dy + m[2] * dz
            trace = m[3] + m[7] + m[11]
            along = (
                dx * (m[3] * dx + m[4] * dy + m[5] * dz)
                + dy * (m[6] * dx + m[7] * dy + m[8] * dz)
                + dz * (m[9] * dx + m[10] * dy + m[11] * dz)
            )
            far += inverse3 * (first + trace - 3.0 * along * inverse2)
        elif bvh.right[node] < 0:
            for i in range(bvh.start[node], bvh.end[node]):
                real, imaginary, turns = turned_by(x, y, z, triangle_at(bvh.corner, i), real, imaginary, turns)
        else:
            stack[top], stack[top + 1] = bvh.right[node], node + 1
            top += 2
    return (arc_tangent(imaginary, real) + 2.0 * math.pi * turns + 0.5 * far) / (2.0 * math.pi)


@jit_allocating
def fast_winding_numbers(bvh: Any, moments: WindingMoments, points: Array, winding_out: Array) -> None:
    """Compute the winding numbers [-], shape (n,), at points [m], shape (n, 3)."""
    stack = np.empty(STACK, np.int64)
    for i in range(points.shape[0]):
        winding_out[i] = winding_at(bvh, moments, points[i, 0], points[i, 1], points[i, 2], stack)
