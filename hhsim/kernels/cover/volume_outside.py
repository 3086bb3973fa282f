"""Spheres of a cover that move, one at a time, so that less volume of their union lies outside of the mesh.

A sphere has to contain the micro-triangles that are in no other one; it may have any centre from which it reaches
them and protrudes no more than is allowed. Its volume outside that no other sphere has is counted at points of a grid.
"""

import math

import numpy as np

from hhsim.kernels.cover.inscribed_sphere import depth_at
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating, jit_inline
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh

_TRIALS = 10
"""Trials to move a sphere before it is the next one's turn."""
_LONGER, _SHORTER, _SHORTEST = 1.5, 0.85, 1e-3
"""Factors of a sphere's step after success and failure, and the share of the first step at which it begins anew."""


@jit_inline
def _far2(points: Array, p: int, x: float, y: float, z: float) -> float:
    """Compute the squared distance [m²] from (x, y, z) to a point, or to the farthest of a triangle's three."""
    dx, dy, dz = points[0, p] - x, points[1, p] - y, points[2, p] - z
    far2 = dx * dx + dy * dy + dz * dz
    for k in range(3, points.shape[0], 3):
        dx, dy, dz = points[k, p] - x, points[k + 1, p] - y, points[k + 2, p] - z
        far2 = max(far2, dx * dx + dy * dy + dz * dz)
    return far2


@jit
def _add_inside(points: Array, x: float, y: float, z: float, radius: float, add: int, count: Indices) -> None:
    """Add to the count of each point or triangle [m], columns of shape (3, N) or (9, N), in a sphere."""
    for p in range(count.shape[0]):
        count[p] += add if _far2(points, p, x, y, z) <= radius * radius else 0


@jit
def _needed_radius(points: Array, x: float, y: float, z: float, count: Indices) -> float:
    """Compute the least radius [m] around (x, y, z) that reaches all that no other sphere has; −1 for none."""
    most = -1.0
    for p in range(count.shape[0]):
        most = max(most, _far2(points, p, x, y, z) if count[p] == 0 else -1.0)
    return math.sqrt(most) if most >= 0.0 else -1.0


@jit
def _free_inside(points: Array, x: float, y: float, z: float, radius: float, count: Indices) -> int:
    """Count the points in a sphere that no other sphere has."""
    free = 0
    for p in range(count.shape[0]):
        free += 1 if (_far2(points, p, x, y, z) <= radius * radius) & (count[p] == 0) else 0
    return free


@jit_allocating
def reduce_outside(
    bvh: MeshBvh, triangles: Array, outside: Array, most: float, shift: Array, step: float, center: Array, radius: Array
) -> int:
    """Move and shrink spheres, centres (k, 3) and radii (k,) [m], in place; return the outside points that are left.

    Each triangle [m], columns of shape (9, N), is in one of them before and after. One after another tries some of the
    shifts, (T, 3), times a step that begins with `step` [m] and follows success. The points outside of the mesh have
    the shape (3, M). No sphere comes to protrude by more than `most` [m].
    """
    spheres = radius.shape[0]
    covered, filled = np.zeros(triangles.shape[1], np.int64), np.zeros(outside.shape[1], np.int64)
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    length = np.full(spheres, step)
    for i in range(spheres):
        _add_inside(triangles, center[i, 0], center[i, 1], center[i, 2], radius[i], 1, covered)
        _add_inside(outside, center[i, 0], center[i, 1], center[i, 2], radius[i], 1, filled)
    for visit in range(-spheres, shift.shape[0] // _TRIALS):
        i = visit % spheres
        x, y, z, r = center[i, 0], center[i, 1], center[i, 2], radius[i]
        _add_inside(triangles, x, y, z, r, -1, covered)
        _add_inside(outside, x, y, z, r, -1, filled)
        least = _free_inside(outside, x, y, z, r, filled)
        # At first each sphere only shrinks.
        for trial in range(_TRIALS if visit >= 0 else 1):
            tx, ty, tz = x, y, z
            if visit >= 0:
                s = shift[visit * _TRIALS + trial]
                tx, ty, tz = x + length[i] * s[0], y + length[i] * s[1], z + length[i] * s[2]
            needed = _needed_radius(triangles, tx, ty, tz, covered) * (1.0 + 1e-12)
            better = False
            if needed >= 0.0:
                depth, _, _, _ = depth_at(bvh, tx, ty, tz, np.inf, stack, stack_distance2)
                if needed - depth <= most:
                    free = _free_inside(outside, tx, ty, tz, needed, filled)
                    better = free < least or (free == least and needed < r)
                    if better:
                        x, y, z, r, least = tx, ty, tz, needed, free
            if visit >= 0:
                length[i] *= _LONGER if better else _SHORTER
                if length[i] < _SHORTEST * step:
                    length[i] = step
        center[i, 0], center[i, 1], center[i, 2], radius[i] = x, y, z, r
        _add_inside(triangles, x, y, z, r, 1, covered)
        _add_inside(outside, x, y, z, r, 1, filled)
    left = 0
    for p in range(filled.shape[0]):
        left += 1 if filled[p] > 0 else 0
    return left
