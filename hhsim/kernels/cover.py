"""A cover of a mesh by few balls that protrude little: greedy inner balls, assignment, radii.

A ball with its centre c at the depth d inside the solid and the radius r protrudes at most r − d (triangle inequality).
Each micro-triangle goes whole to one ball that contains its three corners; balls are convex, so it lies in that ball.
So the cost of a micro-triangle under a ball is (distance of its farthest corner from c) − d, and the largest cost over
the micro-triangles, each under its best ball, bounds the protrusion of the whole cover.
"""

import math

import numpy as np
from numpy.typing import NDArray

from .jit import jit, jit_inline
from .median_tree import STACK
from .mesh_bvh import MeshBvh, closest_on_mesh, outside
from .micro_triangle import MicroTriangles

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_SHRINKS = 40
_STRETCHES = 8


@jit
def far_corner2(corner: Array, i: int, x: float, y: float, z: float) -> float:
    """Squared distance [m²] of (x, y, z) from the farthest corner of micro-triangle i."""
    farthest2 = 0.0
    for v in range(0, 9, 3):
        dx, dy, dz = corner[i, v] - x, corner[i, v + 1] - y, corner[i, v + 2] - z
        farthest2 = max(farthest2, dx * dx + dy * dy + dz * dz)
    return farthest2


@jit
def depth_at(
    bvh: MeshBvh, x: float, y: float, z: float, limit2: float, stack: Indices, stack_distance2: Array
) -> tuple[float, float, float, float]:
    """Depth [m] below the surface, negative outside, and the closest surface point; −inf beyond the limit."""
    triangle, qx, qy, qz, d2, feature = closest_on_mesh(bvh, x, y, z, limit2, stack, stack_distance2)
    if triangle < 0:
        return -np.inf, qx, qy, qz
    depth = math.sqrt(d2)
    if outside(bvh, triangle, feature, x - qx, y - qy, z - qz):
        depth = -depth
    return depth, qx, qy, qz


@jit
def _inner_ball(
    bvh: MeshBvh,
    px: float,
    py: float,
    pz: float,
    nx: float,
    ny: float,
    nz: float,
    radius: float,
    stack: Indices,
    stack_distance2: Array,
) -> tuple[float, float, float, float]:
    """Largest ball inside the solid that touches the surface at p with outward normal n.

    Shrinks from `radius` [m] until no surface point lies inside (Ma, Bae and Choi, 2012).

    Returns:
        (radius [m], and the surface point that stopped it).
    """
    sx, sy, sz = px, py, pz
    for _ in range(_SHRINKS):
        cx, cy, cz = px - radius * nx, py - radius * ny, pz - radius * nz
        limit = radius * (1.0 - 1e-9)
        triangle, qx, qy, qz, _, _ = closest_on_mesh(bvh, cx, cy, cz, limit * limit, stack, stack_distance2)
        if triangle < 0:
            break
        dx, dy, dz = px - qx, py - qy, pz - qz
        along = dx * nx + dy * ny + dz * nz
        if not along > 0.0:
            break
        smaller = 0.5 * (dx * dx + dy * dy + dz * dz) / along
        if not smaller < radius:
            break
        radius = smaller
        sx, sy, sz = qx, qy, qz
    return radius, sx, sy, sz


@jit
def _place_ball(
    bvh: MeshBvh,
    micro: MicroTriangles,
    i: int,
    largest: float,
    allowed: float,
    stack: Indices,
    stack_distance2: Array,
    center_out: Array,
) -> float:
    """Place a ball for micro-triangle i; return its depth.

    It starts as the largest inner ball that touches there, and then goes deeper along the medial axis, away from both
    points that it touches, while its cost for i stays within `allowed` [m]: a deeper ball covers more around i.
    """
    t = micro.corner[i]
    px, py, pz = (t[0] + t[3] + t[6]) / 3.0, (t[1] + t[4] + t[7]) / 3.0, (t[2] + t[5] + t[8]) / 3.0
    nx, ny, nz = micro.normal[i, 0], micro.normal[i, 1], micro.normal[i, 2]
    radius, sx, sy, sz = _inner_ball(bvh, px, py, pz, nx, ny, nz, largest, stack, stack_distance2)
    x, y, z = px - radius * nx, py - radius * ny, pz - radius * nz
    depth, _, _, _ = depth_at(bvh, x, y, z, np.inf, stack, stack_distance2)

    ux, uy, uz = (x - sx) / radius - nx, (y - sy) / radius - ny, (z - sz) / radius - nz
    norm = math.sqrt(ux * ux + uy * uy + uz * uz)
    if norm > 1e-6:
        ux, uy, uz = ux / norm, uy / norm, uz / norm
        x0, y0, z0 = x, y, z
        good, step = 0.0, max(depth, allowed)
        for _ in range(_STRETCHES):
            length = good + step
            tx, ty, tz = x0 + length * ux, y0 + length * uy, z0 + length * uz
            deeper, _, _, _ = depth_at(bvh, tx, ty, tz, np.inf, stack, stack_distance2)
            if deeper > depth and math.sqrt(far_corner2(micro.corner, i, tx, ty, tz)) - deeper <= allowed:
                good, depth = length, deeper
                x, y, z = tx, ty, tz
                step *= 1.5
            else:
                step *= 0.4
    center_out[0], center_out[1], center_out[2] = x, y, z
    return depth


@jit_inline
def _gap(micro: MicroTriangles, node: int, x: float, y: float, z: float) -> float:
    """Distance [m] from (x, y, z) to the centre of a node's ball."""
    dx, dy, dz = micro.center[node, 0] - x, micro.center[node, 1] - y, micro.center[node, 2] - z
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@jit
def _offer_ball(
    micro: MicroTriangles,
    ball: int,
    x: float,
    y: float,
    z: float,
    depth: float,
    owner: Indices,
    cost: Array,
    worst: Array,
    stack: Indices,
    touched: Indices,
) -> None:
    """Give the ball every micro-triangle that costs less under it, and keep the nodes' largest costs right."""
    stack[0] = 0
    top, count = 1, 0
    while top > 0:
        top -= 1
        node = stack[top]
        if _gap(micro, node, x, y, z) - micro.radius[node] - depth >= worst[node]:
            continue
        touched[count] = node
        count += 1
        if micro.right[node] < 0:
            for i in range(micro.start[node], micro.end[node]):
                limit = cost[i] + depth
                if limit > 0.0:
                    far2 = far_corner2(micro.corner, i, x, y, z)
                    if far2 < limit * limit:
                        cost[i] = math.sqrt(far2) - depth
                        owner[i] = ball
        else:
            stack[top], stack[top + 1] = micro.right[node], node + 1
            top += 2
    # Nodes were touched in preorder: backwards, children come before their parents.
    for j in range(count - 1, -1, -1):
        node = touched[j]
        if micro.right[node] < 0:
            most = -np.inf
            for i in range(micro.start[node], micro.end[node]):
                most = max(most, cost[i])
            worst[node] = most
        else:
            worst[node] = max(worst[node + 1], worst[micro.right[node]])


@jit
def greedy_cover(
    bvh: MeshBvh,
    micro: MicroTriangles,
    largest: float,
    reach: float,
    tolerance: float,
    begin: int,
    center_out: Array,
    depth_out: Array,
    owner_out: Indices,
    cost_out: Array,
) -> int:
    """Place balls one after another where the cover costs most (k-centre).

    Args:
        bvh: over the mesh.
        micro: micro-triangles of the same mesh.
        largest: radius [m] from which inner balls shrink.
        reach: share [-] of the largest cost that a new ball may cost its own micro-triangle.
        tolerance: stop when no cost is larger [m].
        begin: number of balls to place now; the call goes on from ball `begin`, 0 for a new cover.
        center_out: centres [m], shape (balls, 3).
        depth_out: their depths [m], shape (balls,); negative for a centre outside.
        owner_out: ball of each micro-triangle, shape (M,).
        cost_out: cost of each micro-triangle [m], shape (M,).

    Returns:
        Number of balls placed in all; less than there is room for, when another one would gain nothing.
    """
    stack = np.empty(2 * STACK, np.int64)
    stack_distance2 = np.empty(2 * STACK)
    touched = np.empty(micro.start.shape[0], np.int64)
    worst = np.empty(micro.start.shape[0])
    if begin == 0:
        owner_out[:] = -1
        cost_out[:] = np.inf
    for node in range(worst.shape[0] - 1, -1, -1):
        if micro.right[node] < 0:
            worst[node] = -np.inf
            for i in range(micro.start[node], micro.end[node]):
                worst[node] = max(worst[node], cost_out[i])
        else:
            worst[node] = max(worst[node + 1], worst[micro.right[node]])

    for ball in range(begin, depth_out.shape[0]):
        node = 0
        while micro.right[node] >= 0:
            node = node + 1 if worst[node + 1] >= worst[micro.right[node]] else micro.right[node]
        chosen = micro.start[node]
        for i in range(micro.start[node], micro.end[node]):
            if cost_out[i] > cost_out[chosen]:
                chosen = i
        before = cost_out[chosen]
        if before <= tolerance:
            return ball
        allowed = reach * before if before < np.inf else 0.0
        for _ in range(2):
            depth = _place_ball(bvh, micro, chosen, largest, allowed, stack, stack_distance2, center_out[ball])
            x, y, z = center_out[ball, 0], center_out[ball, 1], center_out[ball, 2]
            after = math.sqrt(far_corner2(micro.corner, chosen, x, y, z)) - depth
            if after < before:
                break
            allowed = 0.0
        if not after < before:
            return ball
        depth_out[ball] = depth
        _offer_ball(micro, ball, x, y, z, depth, owner_out, cost_out, worst, stack, touched)
    return int(depth_out.shape[0])


@jit
def assign(micro: MicroTriangles, center: Array, depth: Array, owner_out: Indices, cost_out: Array) -> None:
    """Give every micro-triangle to the ball under which it costs least: exact, by bounds on the nodes.

    Args:
        micro: the micro-triangles.
        center: ball centres [m], shape (balls, 3).
        depth: their depths [m], shape (balls,).
        owner_out: shape (M,).
        cost_out: [m], shape (M,).
    """
    balls = depth.shape[0]
    # Along the path to a node, each level's list keeps the balls of its parent's that can still be best for one below.
    lists = np.empty((STACK, balls), np.int64)
    length = np.empty(STACK, np.int64)
    nearness = np.empty(balls)
    stack = np.empty((STACK, 2), np.int64)
    for j in range(balls):
        lists[0, j] = j
    length[0] = balls
    stack[0, 0], stack[0, 1] = 0, 1
    top = 1
    while top > 0:
        top -= 1
        node, level = stack[top, 0], stack[top, 1]
        x, y, z = micro.center[node, 0], micro.center[node, 1], micro.center[node, 2]
        best = np.inf
        for k in range(length[level - 1]):
            j = lists[level - 1, k]
            dx, dy, dz = center[j, 0] - x, center[j, 1] - y, center[j, 2] - z
            nearness[k] = math.sqrt(dx * dx + dy * dy + dz * dz) - depth[j]
            best = min(best, nearness[k])
        limit = best + 2.0 * micro.radius[node] + 1e-12 * (abs(best) + micro.radius[node])
        count = 0
        for k in range(length[level - 1]):
            if nearness[k] <= limit:
                lists[level, count] = lists[level - 1, k]
                count += 1
        length[level] = count
        if micro.right[node] < 0:
            for i in range(micro.start[node], micro.end[node]):
                least, owner = np.inf, -1
                for k in range(count):
                    j = lists[level, k]
                    room = least + depth[j]
                    if room > 0.0:
                        far2 = far_corner2(micro.corner, i, center[j, 0], center[j, 1], center[j, 2])
                        if far2 < room * room:
                            least, owner = math.sqrt(far2) - depth[j], j
                cost_out[i], owner_out[i] = least, owner
        else:
            stack[top, 0], stack[top, 1] = micro.right[node], level + 1
            stack[top + 1, 0], stack[top + 1, 1] = node + 1, level + 1
            top += 2


@jit
def covering_radius(micro: MicroTriangles, center: Array, owner: Indices, radius_out: Array) -> None:
    """Least radius [m] of each ball, shape (balls,), that reaches all its micro-triangles; −1 for a ball with none."""
    radius_out[:] = -1.0
    for i in range(owner.shape[0]):
        j = owner[i]
        far2 = far_corner2(micro.corner, i, center[j, 0], center[j, 1], center[j, 2])
        radius_out[j] = max(radius_out[j], math.sqrt(far2))
