"""The places of a surface that cost most under the spheres of a cover, between points that were looked at, too."""

import math

import numpy as np

from hhsim.kernels.cover.joint_descent import ROUNDING
from hhsim.kernels.cover.micro_triangle import CUT_STACK
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.triangle import halve_triangle, longest_edge, triangle_at

_HALVINGS = 40


@jit
def _find_near(t: Array, center: Array, depth: Array, near_out: Indices) -> int:
    """Find the spheres under which a place of a triangle may cost least; return how many."""
    square = 0.0
    for v in (3, 6):
        square = max(square, (t[v] - t[0]) ** 2 + (t[v + 1] - t[1]) ** 2 + (t[v + 2] - t[2]) ** 2)
    # At no place of the triangle a cost differs by over this from that at its first corner.
    size, least = math.sqrt(square), np.inf
    for i in range(depth.shape[0]):
        dx, dy, dz = t[0] - center[i, 0], t[1] - center[i, 1], t[2] - center[i, 2]
        least = min(least, math.sqrt(dx * dx + dy * dy + dz * dz) - depth[i])
    count = 0
    for i in range(depth.shape[0]):
        dx, dy, dz = t[0] - center[i, 0], t[1] - center[i, 1], t[2] - center[i, 2]
        if math.sqrt(dx * dx + dy * dy + dz * dz) - depth[i] <= least + 2.0 * size + ROUNDING:
            near_out[count] = i
            count += 1
    return count


@jit
def _corner_costs(t: Array, center: Array, depth: Array, near: Indices, count: int, costs_out: Array) -> None:
    """Compute the costs [m] of a triangle's corners a, b, c and, last, of all of it under one of the near spheres."""
    costs_out[:] = np.inf
    for k in range(count):
        i, most = near[k], -np.inf
        for v in range(3):
            dx, dy, dz = t[3 * v] - center[i, 0], t[3 * v + 1] - center[i, 1], t[3 * v + 2] - center[i, 2]
            cost = math.sqrt(dx * dx + dy * dy + dz * dz) - depth[i]
            costs_out[v] = min(costs_out[v], cost)
            most = max(most, cost)
        costs_out[3] = min(costs_out[3], most)


@jit_allocating
def find_dearest(
    corner: Array, center: Array, depth: Array, doubt: float, known: float, piece_out: Array, cost_out: Array
) -> float:
    """Find the piece of each triangle, (M, 9) [m], with the corner that costs most under its best sphere.

    Only where a triangle may cost more than all that is known, by the share `doubt` of it, it is halved, and the halves
    looked at: where spheres meet, the corners of a small piece belong to each of them. Writes pieces, (M, 9) [m], and
    the costs of those corners, (M,) [m]; returns a bound of the cost of the whole surface.
    """
    stack, level, costs = np.empty((CUT_STACK, 9)), np.empty(CUT_STACK, np.int64), np.empty(4)
    near, bound = np.empty(depth.shape[0], np.int64), 0.0
    for m in range(corner.shape[0]):
        cost_out[m] = -np.inf
        count = _find_near(corner[m], center, depth, near)
        stack[0] = corner[m]
        level[0] = 0
        top = 1
        while top > 0:
            top -= 1
            t = stack[top]
            _corner_costs(t, center, depth, near, count, costs)
            for v in range(3):
                if costs[v] > cost_out[m]:
                    cost_out[m] = costs[v]
                    piece_out[m] = t
            known = max(known, cost_out[m])
            if costs[3] <= known * (1.0 + doubt) or level[top] >= _HALVINGS or top + 2 > CUT_STACK:
                bound = max(bound, costs[3])
                continue
            triangle = triangle_at(stack, top)
            halve_triangle(triangle, longest_edge(triangle)[0], stack[top : top + 2])
            level[top] += 1
            level[top + 1] = level[top]
            top += 2
    return bound
