"""Volume of a cover outside of its mesh, and sampled distances between both.

Spheres of a cover that move, one at a time, so that less volume of their union lies outside of the mesh.

A sphere has to contain the micro-triangles that are in no other one; it may have any centre from which it reaches
them and protrudes no more than is allowed. Its volume outside that no other sphere has is counted at points of a grid.

Sampled gap and protrusion of a union of spheres, by brute force and independent of the tree builder.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.cover.sphere_descent import depth_at
from hhsim.kernels.jit import Array, Indices, as_int64, jit, jit_allocating
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh

Flags = NDArray[np.bool_]

_TRIALS = 10
"""Trials to move a sphere before it is the next one's turn."""
_LONGER, _SHORTER, _SHORTEST = 1.5, 0.85, 1e-3
"""Factors of a sphere's step after success and failure, and the share of the first step at which it begins anew."""


@jit
def _far_squares(points: Array, count: int, x: float, y: float, z: float, square_out: Array) -> None:
    """Compute squared distances [m²] from (x, y, z) to the first points, or to the farthest of each triangle's three.

    Points or triangles [m] are columns of shape (3, N) or (9, N).
    """
    square = square_out[:count]
    square[:] = 0.0
    for k in range(0, points.shape[0], 3):
        px, py, pz = points[k, :count], points[k + 1, :count], points[k + 2, :count]
        # Without branches, so that the loop uses the vector unit.
        for p in range(count):
            dx, dy, dz = px[p] - x, py[p] - y, pz[p] - z
            square[p] = max(square[p], dx * dx + dy * dy + dz * dz)


@jit
def _count_inside(
    points: Array, sphere: tuple[float, float, float, float], square: Array, inside_out: Indices, count: Indices
) -> None:
    """Mark the points or triangles in a sphere, centre and radius [m], and count it for each."""
    x, y, z, radius = sphere
    _far_squares(points, as_int64(points.shape[1]), x, y, z, square)
    for p in range(count.shape[0]):
        inside_out[p] = 1 if square[p] <= radius * radius else 0
        count[p] += inside_out[p]


@jit
def _keep_free(points: Array, inside: Indices, count: Indices, free_out: Array) -> int:
    """Take the marks of a sphere off the counts, and copy the columns that no other sphere has; return how many."""
    free = as_int64(0)
    for p in range(count.shape[0]):
        count[p] -= inside[p]
        if count[p] == 0:
            for k in range(points.shape[0]):
                free_out[k, free] = points[k, p]
            free += 1
    return free


@jit
def _needed_radius(points: Array, count: int, x: float, y: float, z: float, square: Array) -> float:
    """Compute the least radius [m] around (x, y, z) that reaches the first points or triangles; −1 for none."""
    _far_squares(points, count, x, y, z, square)
    most = -1.0
    for p in range(count):
        most = max(most, square[p])
    return math.sqrt(most) if most >= 0.0 else -1.0


@jit
def _number_inside(points: Array, count: int, x: float, y: float, z: float, radius: float, square: Array) -> int:
    """Count which of the first points are in a sphere."""
    _far_squares(points, count, x, y, z, square)
    number = 0
    for p in range(count):
        number += 1 if square[p] <= radius * radius else 0
    return number


@jit_allocating
def lie_outside(bvh: MeshBvh, points: Array, most: float, outside_out: Flags) -> None:
    """Mark the points [m], shape (n, 3), that lie outside of the mesh by `most` [m] or less."""
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    for i in range(points.shape[0]):
        depth, _, _, _ = depth_at(bvh, points[i, 0], points[i, 1], points[i, 2], most * most, stack, stack_distance2)
        outside_out[i] = -np.inf < depth < 0.0


@jit_allocating
def reduce_outside(
    bvh: MeshBvh, triangles: Array, outside: Array, most: float, shift: Array, step: float, center: Array, radius: Array
) -> None:
    """Move and shrink spheres, centres (k, 3) and radii (k,) [m], in place, so that fewer outside points are in them.

    Each triangle [m], columns of shape (9, N), is in one of them before and after. One after another tries some of the
    shifts, (T, 3), times a step that begins with `step` [m] and follows success. The points outside of the mesh have
    the shape (3, M). No sphere comes to protrude by more than `most` [m].
    """
    spheres = radius.shape[0]
    covered, filled = np.zeros(triangles.shape[1], np.int64), np.zeros(outside.shape[1], np.int64)
    covers, fills = np.empty((spheres, len(covered)), np.int64), np.empty((spheres, len(filled)), np.int64)
    own, empty, square = np.empty(triangles.shape), np.empty(outside.shape), np.empty(max(len(covered), len(filled)))
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    length = np.full(spheres, step)
    for i in range(spheres):
        sphere = center[i, 0], center[i, 1], center[i, 2], radius[i]
        _count_inside(triangles, sphere, square, covers[i], covered)
        _count_inside(outside, sphere, square, fills[i], filled)
    for visit in range(-spheres, shift.shape[0] // _TRIALS):
        i = visit % spheres
        x, y, z, r = center[i, 0], center[i, 1], center[i, 2], radius[i]
        owned = _keep_free(triangles, covers[i], covered, own)
        emptied = _keep_free(outside, fills[i], filled, empty)
        least = _number_inside(empty, emptied, x, y, z, r, square)
        # At first each sphere only shrinks.
        for trial in range(_TRIALS if visit >= 0 else 1):
            tx, ty, tz = x, y, z
            if visit >= 0:
                s = shift[visit * _TRIALS + trial]
                tx, ty, tz = x + length[i] * s[0], y + length[i] * s[1], z + length[i] * s[2]
            needed = _needed_radius(own, owned, tx, ty, tz, square) * (1.0 + 1e-12)
            better = False
            if needed >= 0.0:
                free = _number_inside(empty, emptied, tx, ty, tz, needed, square)
                if free < least or (free == least and needed < r):
                    depth, _, _, _ = depth_at(bvh, tx, ty, tz, np.inf, stack, stack_distance2)
                    better = needed - depth <= most
                if better:
                    x, y, z, r, least = tx, ty, tz, needed, free
            if visit >= 0:
                length[i] *= _LONGER if better else _SHORTER
                if length[i] < _SHORTEST * step:
                    length[i] = step
        center[i, 0], center[i, 1], center[i, 2], radius[i] = x, y, z, r
        _count_inside(triangles, (x, y, z, r), square, covers[i], covered)
        _count_inside(outside, (x, y, z, r), square, fills[i], filled)


@jit
def union_distance(points: Array, x: Array, y: Array, z: Array, radius: Array, distance_out: Array) -> None:
    """Compute the distance [m] from points, shape (n, 3), to a union of spheres: 0 inside, shape (n,)."""
    spheres = radius.shape[0]
    latest = -1
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        least = np.inf
        # Neighbouring samples tend to lie in the same sphere.
        for k in range(-1, spheres):
            j = latest if k < 0 else k
            if j < 0:
                continue
            dx, dy, dz = x[j] - px, y[j] - py, z[j] - pz
            least = min(least, math.sqrt(dx * dx + dy * dy + dz * dz) - radius[j])
            if least <= 0.0:
                latest = j
                break
        distance_out[i] = max(least, 0.0)


@jit
def exposed(points: Array, owner: Indices, x: Array, y: Array, z: Array, radius: Array, exposed_out: Flags) -> None:
    """Mark the points [m], shape (n, 3), each on the surface of its sphere `owner`, that lie in no other sphere."""
    spheres = radius.shape[0]
    latest = -1
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        exposed_out[i] = True
        for k in range(-1, spheres):
            j = latest if k < 0 else k
            if j < 0 or j == owner[i]:
                continue
            dx, dy, dz = x[j] - px, y[j] - py, z[j] - pz
            if dx * dx + dy * dy + dz * dz < radius[j] * radius[j]:
                exposed_out[i] = False
                latest = j
                break
