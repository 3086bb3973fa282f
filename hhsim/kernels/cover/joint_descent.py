"""Descent of few spheres together, and the places of a surface where they protrude most.

Few spheres that move together, from any start to where their largest cost at points of a surface is least.

The cost of a point under a sphere is (its distance from the centre c) − depth(c), and each point counts under its best
sphere. A descent of one sphere after another, each with the points that it has, is stuck where two of them would have
to exchange points: so all move at once, down the slope of a sum over the points in which the dearest count most. How
much more they count grows as the steps become shorter, until only the dearest count at all (annealing).

The places of a surface that cost most under the spheres of a cover, between points that were looked at, too.
"""

import math

import numpy as np

from hhsim.kernels.cover.certify import CUT_STACK, MicroTriangles
from hhsim.kernels.cover.sphere_descent import UNKNOWN, depth_at, same_side
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating, jit_inline
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh
from hhsim.kernels.triangle import halve_triangle, longest_edge, triangle_at

_INERTIA = 0.5
"""Share of the last step that stays in the next one."""
_LATER = 0.2
"""Length of a cycle's first steps in the last cycle, as a share of those in the first one."""
_DEARER = 1.6, 1.2
"""Cost of the points of a sphere that is removed, under their second spheres, as a share of the largest cost: most in
the first and in the last cycle."""
BLOCK = 64
"""Number of points, near each other as they come, that leave the same spheres out."""
ROUNDING = 1e-9
"""Error [m] of a cost, and far more: meshes are about 1 m wide here."""
_TOWARDS = 0.4
"""Place of a sphere that was removed: between the worst sphere's centre and its dearest point."""


@jit
def enclose_blocks(points: Array, ball_out: Array) -> None:
    """Compute balls around so many points after another, columns of shape (3, N): centres and radii, (N / BLOCK, 4)."""
    for block in range(ball_out.shape[0]):
        first, last = BLOCK * block, min(BLOCK * (block + 1), points.shape[1])
        ball, square = ball_out[block], 0.0
        for k in range(3):
            low = high = points[k, first]
            for p in range(first, last):
                low, high = min(low, points[k, p]), max(high, points[k, p])
            ball[k] = 0.5 * (low + high)
        for p in range(first, last):
            dx, dy, dz = points[0, p] - ball[0], points[1, p] - ball[1], points[2, p] - ball[2]
            square = max(square, dx * dx + dy * dy + dz * dz)
        ball[3] = math.sqrt(square)


@jit
def _add_costs(
    x: Array,
    y: Array,
    z: Array,
    i: int,
    sphere: tuple[float, float, float, float],
    owner_out: Indices,
    cost_out: Array,
    second_out: Array,
) -> None:
    cx, cy, cz, d = sphere
    # Without branches, so that the loop uses the vector unit.
    for p in range(x.shape[0]):
        dx, dy, dz = x[p] - cx, y[p] - cy, z[p] - cz
        cost = math.sqrt(dx * dx + dy * dy + dz * dz) - d
        best = cost_out[p]
        owner_out[p] = i if cost < best else owner_out[p]
        second_out[p] = min(second_out[p], max(cost, best))
        cost_out[p] = min(cost, best)


@jit
def find_owners(
    points: Array,
    ball: Array,
    center: Array,
    depth: Array,
    near: Array,
    owner_out: Indices,
    cost_out: Array,
    second_cost_out: Array,
) -> int:
    """Find for each point [m], columns of shape (3, N), its best sphere, its cost and that under its second one [m].

    `ball` is of `enclose_blocks`: spheres that are not the best or the second of any point of a block are left out
    there. `near` is workspace of shape (k,). Returns the dearest point.
    """
    cost_out[:] = np.inf
    second_cost_out[:] = np.inf
    owner_out[:] = -1
    for block in range(ball.shape[0]):
        a, b = BLOCK * block, min(BLOCK * (block + 1), points.shape[1])
        # How much a point at the ball's centre costs; at no point of the block it is more or less by over its radius.
        least, second = np.inf, np.inf
        for i in range(depth.shape[0]):
            dx, dy, dz = ball[block, 0] - center[i, 0], ball[block, 1] - center[i, 1], ball[block, 2] - center[i, 2]
            near[i] = math.sqrt(dx * dx + dy * dy + dz * dz) - depth[i]
            second = min(second, max(near[i], least))
            least = min(least, near[i])
        x, y, z = points[0, a:b], points[1, a:b], points[2, a:b]
        for i in range(depth.shape[0]):
            if near[i] - second <= 2.0 * ball[block, 3] + ROUNDING:
                sphere = center[i, 0], center[i, 1], center[i, 2], depth[i]
                _add_costs(x, y, z, i, sphere, owner_out[a:b], cost_out[a:b], second_cost_out[a:b])
    dearest = 0
    for p in range(points.shape[1]):
        if cost_out[p] > cost_out[dearest]:
            dearest = p
    return dearest


@jit
def _sum_slopes(
    points: Array, center: Array, owner: Indices, cost: Array, largest: float, sharpness: float, slope_out: Array
) -> None:
    """Sum the slopes of the distances of each sphere's points, by weight; the last column is the sum of the weights."""
    slope_out[:] = 0.0
    for p in range(cost.shape[0]):
        z = sharpness * (1.0 - cost[p] / largest)
        if not z < 8.0:
            continue
        weight = 1.0 - 0.125 * z
        weight *= weight
        weight *= weight
        weight *= weight
        i = owner[p]
        dx, dy, dz = center[i, 0] - points[0, p], center[i, 1] - points[1, p], center[i, 2] - points[2, p]
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        share = weight / distance if distance > 0.0 else 0.0
        slope_out[i, 0] += share * dx
        slope_out[i, 1] += share * dy
        slope_out[i, 2] += share * dz
        slope_out[i, 3] += weight


@jit_inline
def _square(x: float, y: float, z: float) -> float:
    return x * x + y * y + z * z


@jit_allocating
def descend_together(
    bvh: MeshBvh,
    points: Array,
    cycles: int,
    rounds: int,
    longest: float,
    shortest: float,
    bluntest: float,
    sharpest: float,
    exchanged: int,
    center: Array,
) -> float:
    """Move spheres, centres of shape (k, 3) [m], in place to the best covers of points that `cycles` of descent find.

    Each cycle has `rounds` steps, from `longest` to `shortest` [m]. A point has the weight (1 − z/8)⁸, about e⁻ᶻ, with
    z = sharpness × (1 − its cost / the largest), from `bluntest` to `sharpest` [-]. Then up to `exchanged` spheres that
    others can nearly stand in for jump to where the cover is worst. Points are columns of shape (3, N). Returns the
    largest cost [m] of the best.
    """
    spheres, count = center.shape[0], points.shape[1]
    owner, cost, second = np.empty(count, np.int64), np.empty(count), np.empty(count)
    depth, slope, step = np.empty(spheres), np.empty((spheres, 4)), np.empty((spheres, 3))
    away, spare, best, near = np.empty((spheres, 3)), np.empty(spheres), center.copy(), np.empty(spheres)
    before, closest = np.empty((spheres, 3)), np.empty((spheres, 3))
    ball = np.empty(((count + BLOCK - 1) // BLOCK, 4))
    enclose_blocks(points, ball)
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    least = np.inf
    for cycle in range(cycles):
        late = cycle / max(cycles - 1, 1)
        first = longest * (1.0 - late * (1.0 - _LATER))
        step[:] = 0.0
        for turn in range(rounds + 1):
            for i in range(spheres):
                x, y, z = center[i, 0], center[i, 1], center[i, 2]
                limit2, side = np.inf, UNKNOWN
                if turn > 0:
                    # No farther than the place that was the closest one before the step.
                    limit2 = _square(x - closest[i, 0], y - closest[i, 1], z - closest[i, 2]) * (1.0 + 1e-9) + 1e-18
                    side = same_side(depth[i], _square(x - before[i, 0], y - before[i, 1], z - before[i, 2]))
                depth[i], qx, qy, qz = depth_at(bvh, x, y, z, limit2, stack, stack_distance2, side)
                inverse = 1.0 / depth[i] if depth[i] != 0.0 else 0.0
                away[i, 0], away[i, 1], away[i, 2] = (x - qx) * inverse, (y - qy) * inverse, (z - qz) * inverse
                before[i, 0], before[i, 1], before[i, 2] = x, y, z
                closest[i, 0], closest[i, 1], closest[i, 2] = qx, qy, qz
            dearest = find_owners(points, ball, center, depth, near, owner, cost, second)
            largest = cost[dearest]
            if largest < least:
                least = largest
                best[:] = center
            if turn == rounds or not largest > 0.0:
                break
            done = turn / max(rounds - 1, 1)
            length = first / (1.0 + done * (first / shortest - 1.0))
            sharpness = bluntest / (1.0 - done * (1.0 - bluntest / sharpest))
            _sum_slopes(points, center, owner, cost, largest, sharpness, slope)
            for i in range(spheres):
                inverse = 1.0 / slope[i, 3] if slope[i, 3] > 0.0 else 0.0
                for k in range(3):
                    down = slope[i, k] * inverse - away[i, k] if inverse > 0.0 else 0.0
                    step[i, k] = _INERTIA * step[i, k] + (1.0 - _INERTIA) * down
                    center[i, k] -= length * step[i, k]
        if cycle + 1 == cycles:
            break
        dearer = _DEARER[0] + late * (_DEARER[1] - _DEARER[0])
        for _ in range(exchanged):
            spare[:] = 0.0
            for p in range(count):
                spare[owner[p]] = max(spare[owner[p]], second[p])
            removed = np.argmin(spare)
            worst = owner[dearest]
            if removed == worst or spare[removed] > dearer * cost[dearest]:
                break
            for k in range(3):
                center[removed, k] = center[worst, k] + _TOWARDS * (points[k, dearest] - center[worst, k])
            x, y, z = center[removed, 0], center[removed, 1], center[removed, 2]
            depth[removed], _, _, _ = depth_at(bvh, x, y, z, np.inf, stack, stack_distance2)
            dearest = find_owners(points, ball, center, depth, near, owner, cost, second)
    center[:] = best
    return least


_HALVINGS = 40


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
    micro: MicroTriangles,
    center: Array,
    depth: Array,
    doubt: float,
    known: float,
    dear: float,
    piece_out: Array,
    cost_out: Array,
) -> float:
    """Find the piece of each micro-triangle, (M, 9) [m], with the corner that costs most under its best sphere.

    Only where a triangle may cost more than all that is known, by the share `doubt` of it, it is halved, and the halves
    looked at: where spheres meet, the corners of a small piece belong to each of them. Writes pieces, (M, 9) [m], and
    the costs of those corners, (M,) [m], −inf where all cost at most `dear` [m], which is less than `known`; returns a
    bound of the cost of the whole surface. The micro-triangles are as they were cut, none halved since.
    """
    stack, level, costs = np.empty((CUT_STACK, 9)), np.empty(CUT_STACK, np.int64), np.empty(4)
    spheres, near, value = depth.shape[0], np.empty(depth.shape[0], np.int64), np.empty(depth.shape[0])
    cost_out[:] = -np.inf
    bound = 0.0
    for node in range(micro.start.shape[0]):
        if micro.right[node] >= 0:
            continue
        # At no place of a block a cost differs by over its radius from that at its centre.
        x, y, z = micro.center[node, 0], micro.center[node, 1], micro.center[node, 2]
        radius, least = micro.radius[node], np.inf
        for i in range(spheres):
            value[i] = math.sqrt(_square(x - center[i, 0], y - center[i, 1], z - center[i, 2])) - depth[i]
            least = min(least, value[i])
        if least + radius <= dear - ROUNDING:
            continue
        count = 0
        for i in range(spheres):
            if value[i] <= least + 2.0 * radius + ROUNDING:
                near[count] = i
                count += 1
        for m in range(micro.start[node], micro.end[node]):
            stack[0] = micro.corner[m]
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
