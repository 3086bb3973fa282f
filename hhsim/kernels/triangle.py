"""Triangles: closest point and its feature, crossing with a ray, farthest corner, longest edge, halving across it."""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.jit import Array, Indices, jit, jit_inline

_SLIVER = 1e-12
"""Squared sine of an angle under which a triangle counts as its three edges: its barycentric weights are noise."""
_EQUAL = 1.0 - 1e-6
"""Ratio of squared lengths from which edges count as equal, so that a rotated triangle is halved like the triangle."""


class Triangle(NamedTuple):
    """Corners a, b and c [m]."""

    ax: float
    ay: float
    az: float
    bx: float
    by: float
    bz: float
    cx: float
    cy: float
    cz: float


@jit_inline
def triangle_at(corner: Array, i: int) -> Triangle:
    """Return triangle i of corners [m], shape (·, 9)."""
    t = corner[i]
    return Triangle(t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8])


@jit_inline
def _closest_on_segment(
    px: float, py: float, pz: float, ax: float, ay: float, az: float, bx: float, by: float, bz: float
) -> tuple[float, float, float, float, int]:
    """Return the closest point of ab as (x, y, z, distance², end): end is 0 at a, 1 at b, 2 between."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    along = ux * (px - ax) + uy * (py - ay) + uz * (pz - az)
    length2 = ux * ux + uy * uy + uz * uz
    if along <= 0.0:
        x, y, z, end = ax, ay, az, 0
    elif along >= length2:
        x, y, z, end = bx, by, bz, 1
    else:
        t = along / length2
        x, y, z, end = ax + t * ux, ay + t * uy, az + t * uz, 2
    dx, dy, dz = px - x, py - y, pz - z
    return x, y, z, dx * dx + dy * dy + dz * dz, end


@jit_inline
def _closest_on_edges(px: float, py: float, pz: float, triangle: Triangle) -> tuple[float, float, float, float, int]:
    """Return what `closest_on_triangle` does, for a triangle without area."""
    ax, ay, az, bx, by, bz, cx, cy, cz = triangle
    x, y, z, best, end = _closest_on_segment(px, py, pz, ax, ay, az, bx, by, bz)
    feature = 4 if end == 2 else 1 + end
    x2, y2, z2, d2, end = _closest_on_segment(px, py, pz, bx, by, bz, cx, cy, cz)
    if d2 < best:
        x, y, z, best = x2, y2, z2, d2
        feature = 5 if end == 2 else 2 + end
    x2, y2, z2, d2, end = _closest_on_segment(px, py, pz, cx, cy, cz, ax, ay, az)
    if d2 < best:
        x, y, z, best = x2, y2, z2, d2
        feature = 6 if end == 2 else (3 if end == 0 else 1)
    return x, y, z, best, feature


@jit_inline
def closest_on_triangle(px: float, py: float, pz: float, triangle: Triangle) -> tuple[float, float, float, float, int]:
    """Return the closest point of a triangle to the point p as (x, y, z, distance², feature).

    The feature is 0 for the face, 1, 2, 3 for the corners a, b, c, and 4, 5, 6 for the edges ab, bc, ca. By Voronoi
    regions (Ericson, Real-Time Collision Detection, 5.1.5); the point always lies on the triangle, so that a distance
    is never too small. Slivers and triangles without area are treated as their three edges.
    """
    ax, ay, az, bx, by, bz, cx, cy, cz = triangle
    abx, aby, abz = bx - ax, by - ay, bz - az
    acx, acy, acz = cx - ax, cy - ay, cz - az
    apx, apy, apz = px - ax, py - ay, pz - az
    d1 = abx * apx + aby * apy + abz * apz
    d2 = acx * apx + acy * apy + acz * apz
    if d1 <= 0.0 and d2 <= 0.0:
        return ax, ay, az, apx * apx + apy * apy + apz * apz, 1
    bpx, bpy, bpz = px - bx, py - by, pz - bz
    d3 = abx * bpx + aby * bpy + abz * bpz
    d4 = acx * bpx + acy * bpy + acz * bpz
    if d3 >= 0.0 and d4 <= d3:
        return bx, by, bz, bpx * bpx + bpy * bpy + bpz * bpz, 2
    cpx, cpy, cpz = px - cx, py - cy, pz - cz
    d5 = abx * cpx + aby * cpy + abz * cpz
    d6 = acx * cpx + acy * cpy + acz * cpz
    if d6 >= 0.0 and d5 <= d6:
        return cx, cy, cz, cpx * cpx + cpy * cpy + cpz * cpz, 3

    nx, ny, nz = aby * acz - abz * acy, abz * acx - abx * acz, abx * acy - aby * acx
    area2 = nx * nx + ny * ny + nz * nz
    longest2 = max(abx * abx + aby * aby + abz * abz, acx * acx + acy * acy + acz * acz)
    if not area2 > _SLIVER * longest2 * longest2:
        return _closest_on_edges(px, py, pz, triangle)

    vc = d1 * d4 - d3 * d2
    vb = d5 * d2 - d1 * d6
    va = d3 * d6 - d5 * d4
    if vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        t = d1 / (d1 - d3)
        x, y, z, feature = ax + t * abx, ay + t * aby, az + t * abz, 4
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        t = d2 / (d2 - d6)
        x, y, z, feature = ax + t * acx, ay + t * acy, az + t * acz, 6
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        x, y, z, feature = bx + t * (cx - bx), by + t * (cy - by), bz + t * (cz - bz), 5
    else:
        weight = 1.0 / (va + vb + vc)
        v, w = vb * weight, vc * weight
        x, y, z, feature = ax + abx * v + acx * w, ay + aby * v + acy * w, az + abz * v + acz * w, 0
    dx, dy, dz = px - x, py - y, pz - z
    return x, y, z, dx * dx + dy * dy + dz * dz, feature


@jit_inline
def ray_crossing(t: Array, px: float, py: float, pz: float, dx: float, dy: float, dz: float) -> tuple[float, float]:
    """Return s where p + s·d meets a triangle (9,), −1 if nowhere, < 0 if from behind (Möller and Trumbore, 1997)."""
    ux, uy, uz = t[3] - t[0], t[4] - t[1], t[5] - t[2]
    vx, vy, vz = t[6] - t[0], t[7] - t[1], t[8] - t[2]
    hx, hy, hz = dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx
    det = ux * hx + uy * hy + uz * hz
    if det == 0.0:
        return -1.0, det
    sx, sy, sz = px - t[0], py - t[1], pz - t[2]
    a = (sx * hx + sy * hy + sz * hz) / det
    qx, qy, qz = sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux
    b = (dx * qx + dy * qy + dz * qz) / det
    if not (a >= 0.0 and b >= 0.0 and a + b <= 1.0):
        return -1.0, det
    return (vx * qx + vy * qy + vz * qz) / det, det


@jit
def far_corner2(corner: Array, i: int, x: float, y: float, z: float) -> float:
    """Compute the squared distance [m²] of (x, y, z) from the farthest corner of triangle i, shape (·, 9)."""
    farthest2 = 0.0
    for v in range(0, 9, 3):
        dx, dy, dz = corner[i, v] - x, corner[i, v + 1] - y, corner[i, v + 2] - z
        farthest2 = max(farthest2, dx * dx + dy * dy + dz * dz)
    return farthest2


@jit
def radius_around(corner: Array, order: Indices, start: int, end: int, center: Array) -> float:
    """Compute the radius [m] of the sphere about a centre around triangles order[start:end]; 1e-12 larger."""
    farthest2 = 0.0
    for i in range(start, end):
        farthest2 = max(farthest2, far_corner2(corner, order[i], center[0], center[1], center[2]))
    return math.sqrt(farthest2) * (1.0 + 1e-12)


@jit
def middle_of_box(corner: Array, order: Indices, start: int, end: int, center_out: Array) -> None:
    """Compute the middle of the box around triangles order[start:end] [m], shape (3,)."""
    for m in range(3):
        low, high = np.inf, -np.inf
        for i in range(start, end):
            for k in range(0, 9, 3):
                low = min(low, corner[order[i], k + m])
                high = max(high, corner[order[i], k + m])
        center_out[m] = 0.5 * (low + high)


@jit_inline
def longest_edge(triangle: Triangle) -> tuple[int, float]:
    """Return (edge, longest length²): 0 is ab, 1 bc, 2 ca; the first of equals, whatever their rounding."""
    ax, ay, az, bx, by, bz, cx, cy, cz = triangle
    ab = (bx - ax) * (bx - ax) + (by - ay) * (by - ay) + (bz - az) * (bz - az)
    bc = (cx - bx) * (cx - bx) + (cy - by) * (cy - by) + (cz - bz) * (cz - bz)
    ca = (ax - cx) * (ax - cx) + (ay - cy) * (ay - cy) + (az - cz) * (az - cz)
    most = max(ab, bc, ca)
    if ab >= _EQUAL * most:
        return 0, most
    if bc >= _EQUAL * most:
        return 1, most
    return 2, most


@jit_inline
def halve_triangle(triangle: Triangle, edge: int, halves_out: Array) -> None:
    """Write the halves across an edge a b, shape (2, 9): with its middle m, (m, b, c) and (a, m, c)."""
    ax, ay, az, bx, by, bz, cx, cy, cz = triangle
    if edge == 1:
        ax, ay, az, bx, by, bz, cx, cy, cz = bx, by, bz, cx, cy, cz, ax, ay, az
    elif edge == 2:
        ax, ay, az, bx, by, bz, cx, cy, cz = cx, cy, cz, ax, ay, az, bx, by, bz
    mx, my, mz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
    first, second = halves_out[0], halves_out[1]
    first[0], first[1], first[2], first[3], first[4], first[5] = mx, my, mz, bx, by, bz
    second[0], second[1], second[2], second[3], second[4], second[5] = ax, ay, az, mx, my, mz
    first[6], first[7], first[8] = cx, cy, cz
    second[6], second[7], second[8] = cx, cy, cz
