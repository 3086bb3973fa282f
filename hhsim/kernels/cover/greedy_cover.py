"""Cover of a mesh by few spheres that protrude little: greedy inner spheres, assignment, radii.

A sphere with its centre c at the depth d inside the solid and the radius r protrudes at most r − d (triangle
inequality). Each micro-triangle goes whole to one sphere that contains its three corners; spheres are convex, so it
lies in that sphere. So the cost of a micro-triangle under a sphere is (distance of its farthest corner from c) − d, and
the largest cost over the micro-triangles, each under its best sphere, bounds the protrusion of the whole cover.
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.cover.certify import MicroTriangles
from hhsim.kernels.cover.sphere_descent import WORK, descend_sphere, place_sphere
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating, jit_inline
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh
from hhsim.kernels.triangle import far_corner2, longest_edge, triangle_at

_GAIN = 1e-3


@jit_inline
def _gap(micro: MicroTriangles, node: int, x: float, y: float, z: float) -> float:
    """Compute the distance [m] from (x, y, z) to the centre of a node's sphere."""
    dx, dy, dz = micro.center[node, 0] - x, micro.center[node, 1] - y, micro.center[node, 2] - z
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@jit_inline
def _worst_below(micro: MicroTriangles, node: int, cost: Array, worst: Array) -> float:
    """Compute the largest cost [m] below a node, from its children's or its micro-triangles'."""
    if micro.right[node] >= 0:
        return max(worst[node + 1], worst[micro.right[node]])
    most = -np.inf
    for i in range(micro.start[node], micro.end[node]):
        most = max(most, cost[i])
    return most


@jit
def _offer_sphere(
    micro: MicroTriangles,
    sphere: int,
    center: Array,
    depth: float,
    owner: Indices,
    cost: Array,
    worst: Array,
    stack: Indices,
    touched: Indices,
) -> None:
    """Give the sphere every micro-triangle that costs less under it, and update the nodes' largest costs."""
    x, y, z = center[0], center[1], center[2]
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
                        owner[i] = sphere
        else:
            stack[top], stack[top + 1] = micro.right[node], node + 1
            top += 2
    # Nodes were touched in preorder: backwards, children come before their parents.
    for j in range(count - 1, -1, -1):
        worst[touched[j]] = _worst_below(micro, touched[j], cost, worst)


@jit_allocating
def greedy_cover(
    bvh: MeshBvh,
    micro: MicroTriangles,
    largest: float,
    reach: float,
    trials: int,
    begin: int,
    center_out: Array,
    depth_out: Array,
    owner_out: Indices,
    cost_out: Array,
) -> int:
    """Place spheres from number `begin` on, 0 for a new cover, one after another where it costs most (k-centre).

    Inner spheres shrink from the radius `largest` [m]; a new sphere may cost its own micro-triangle the share `reach`
    of the largest cost; a sphere that no inner sphere can replace descends by `trials` steps. Writes the spheres'
    centres [m] and depths [m], negative outside, and each micro-triangle's sphere and cost [m]. Returns the number of
    spheres in all, fewer than fit when another one would gain nothing.
    """
    stack, stack_distance2 = np.empty(2 * STACK, np.int64), np.empty(2 * STACK)
    touched = np.empty(micro.start.shape[0], np.int64)
    work = np.empty((WORK, 8))
    one = np.empty(1, np.int64)
    worst = np.empty(micro.start.shape[0])
    if begin == 0:
        owner_out[:] = -1
        cost_out[:] = np.inf
    for node in range(worst.shape[0] - 1, -1, -1):
        worst[node] = _worst_below(micro, node, cost_out, worst)

    for sphere in range(begin, depth_out.shape[0]):
        node = 0
        while micro.right[node] >= 0:
            node = node + 1 if worst[node + 1] >= worst[micro.right[node]] else micro.right[node]
        chosen = micro.start[node]
        for i in range(micro.start[node], micro.end[node]):
            if cost_out[i] > cost_out[chosen]:
                chosen = i
        before = cost_out[chosen]
        if before <= 0.0:
            return sphere
        allowed = reach * before if before < np.inf else 0.0
        for attempt in range(3):
            if attempt < 2:
                depth = place_sphere(bvh, micro, chosen, largest, allowed, stack, stack_distance2, center_out[sphere])
                x, y, z = center_out[sphere, 0], center_out[sphere, 1], center_out[sphere, 2]
                after = math.sqrt(far_corner2(micro.corner, chosen, x, y, z)) - depth
                allowed = 0.0
            else:
                # At a sharp edge an inner sphere may be too small to help: start from the present owner.
                one[0] = chosen
                for k in range(3):
                    center_out[sphere, k] = center_out[owner_out[chosen], k]
                after, depth, _, _ = descend_sphere(
                    bvh, micro, one, trials, 0.0, center_out[sphere], work, stack, stack_distance2
                )
            if after < before * (1.0 - _GAIN):
                break
        if not after < before * (1.0 - _GAIN):
            return sphere
        depth_out[sphere] = depth
        _offer_sphere(micro, sphere, center_out[sphere], depth, owner_out, cost_out, worst, stack, touched)
    return int(depth_out.shape[0])


@jit_inline
def _stays_behind(dx: float, dy: float, dz: float, lag: float, far: float, radius: float) -> bool:
    """Return True if a sphere that costs `lag` [m] more than another at a point does so within `radius` [m] of it.

    (dx, dy, dz) leads from one centre to the other, and `far` is the sum of their distances from the point [m]. The
    gradient of the difference of the distances is the difference of two unit vectors, at most 2 |c₁ − c₂| / far long
    (Dunkl and Williams, 1964), and never longer than 2. Without branches, which could not be predicted.
    """
    margin = max(lag - 1e-12 * far, 0.0)
    reach = margin * max(far - 2.0 * radius, 0.0)
    change2 = 4.000001 * radius * radius
    return (margin * margin > change2) | (reach * reach > change2 * (dx * dx + dy * dy + dz * dz))


@jit_allocating
def assign(
    micro: MicroTriangles,
    root: int,
    center: Array,
    depth: Array,
    owner_out: Indices,
    cost_out: Array,
    second_owner_out: Indices,
    second_cost_out: Array,
) -> None:
    """Find for every micro-triangle below a node the two spheres under which it costs least [m], exactly.

    The second owner and cost are −1 and infinity if there is only one sphere.
    """
    spheres = depth.shape[0]
    levels = 4
    while (1 << levels) < 4 * micro.start.shape[0]:
        levels += 1
    # Along the path to a node: the spheres that can still be first or second below, a list for each level, one after
    # another. In columns, so that the loops over distances use the vector unit.
    room = levels * spheres + 1
    sphere = np.empty(room, np.int64)
    cx, cy, cz, deep = np.empty(room), np.empty(room), np.empty(room), np.empty(room)
    distance, keep = np.empty(spheres), np.empty(spheres, np.bool_)
    stack = np.empty((STACK, 3), np.int64)
    for j in range(spheres):
        sphere[j], cx[j], cy[j], cz[j], deep[j] = j, center[j, 0], center[j, 1], center[j, 2], depth[j]
    stack[0, 0], stack[0, 1], stack[0, 2] = root, 0, spheres
    top = 1
    while top > 0:
        top -= 1
        node, begin, end = stack[top, 0], stack[top, 1], stack[top, 2]
        x, y, z = micro.center[node, 0], micro.center[node, 1], micro.center[node, 2]
        for k in range(end - begin):
            dx, dy, dz = cx[begin + k] - x, cy[begin + k] - y, cz[begin + k] - z
            distance[k] = math.sqrt(dx * dx + dy * dy + dz * dz)
        best = second = np.inf
        first_of = second_of = begin
        for k in range(begin, end):
            value = distance[k - begin] - deep[k]
            if value < second:
                second, second_of = value, k
                if value < best:
                    second, second_of, best, first_of = best, first_of, value, k
        radius = micro.radius[node]
        limit = second + 2.0 * radius + 1e-12 * (abs(second) + radius)
        b0, b1, b2, best_far = cx[first_of], cy[first_of], cz[first_of], distance[first_of - begin]
        s0, s1, s2, second_far = cx[second_of], cy[second_of], cz[second_of], distance[second_of - begin]
        for k in range(begin, end):
            far = distance[k - begin]
            value = far - deep[k]
            x, y, z = cx[k], cy[k], cz[k]
            behind_second = _stays_behind(x - s0, y - s1, z - s2, value - second, far + second_far, radius)
            behind_best = _stays_behind(x - b0, y - b1, z - b2, value - best, far + best_far, radius)
            keep[k - begin] = (value <= limit) & (not (behind_second & behind_best))
        # The likely first and second go in front: the others are then refused early.
        last = end
        for front in (first_of, second_of):
            if keep[front - begin]:
                sphere[last], deep[last] = sphere[front], deep[front]
                cx[last], cy[last], cz[last] = cx[front], cy[front], cz[front]
                keep[front - begin] = False
                last += 1
        for k in range(begin, end):
            sphere[last], cx[last], cy[last], cz[last], deep[last] = sphere[k], cx[k], cy[k], cz[k], deep[k]
            last += keep[k - begin]
        if micro.right[node] >= 0:
            stack[top, 0], stack[top, 1], stack[top, 2] = micro.right[node], end, last
            stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = node + 1, end, last
            top += 2
            continue
        for i in range(micro.start[node], micro.end[node]):
            least, next_least = np.inf, np.inf
            owner, next_owner = -1, -1
            t = micro.corner[i]
            px, py, pz, qx, qy, qz, rx, ry, rz = t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8]
            for k in range(end, last):
                x, y, z = cx[k], cy[k], cz[k]
                limit = next_least + deep[k]
                far2 = (px - x) * (px - x) + (py - y) * (py - y) + (pz - z) * (pz - z)
                if not far2 < limit * limit:
                    continue
                far2 = max(far2, (qx - x) * (qx - x) + (qy - y) * (qy - y) + (qz - z) * (qz - z))
                far2 = max(far2, (rx - x) * (rx - x) + (ry - y) * (ry - y) + (rz - z) * (rz - z))
                if far2 < limit * limit and limit > 0.0:
                    next_least, next_owner = math.sqrt(far2) - deep[k], sphere[k]
                    if next_least < least:
                        least, next_least = next_least, least
                        owner, next_owner = next_owner, owner
            cost_out[i], owner_out[i] = least, owner
            second_cost_out[i], second_owner_out[i] = next_least, next_owner


@jit_allocating
def group_by_owner(owner: Indices, first_out: Indices, order_out: Indices) -> None:
    """Sort micro-triangles (N,) by owner, none (-1) first; write where those of each owner begin, and N, (n + 1,)."""
    place = np.zeros(first_out.shape[0], np.int64)
    for i in range(owner.shape[0]):
        place[owner[i] + 1] += 1
    filled = 0
    for j in range(place.shape[0]):
        filled, place[j] = filled + place[j], filled
    first_out[:-1], first_out[-1] = place[1:], filled
    for i in range(owner.shape[0]):
        order_out[place[owner[i] + 1]] = i
        place[owner[i] + 1] += 1


@jit
def farthest_corners(micro: MicroTriangles, center: Array, owner: Indices, distance_out: Array) -> None:
    """Compute the distance [m] of each micro-triangle's farthest corner from its owner's centre, infinite for -1."""
    for i in range(owner.shape[0]):
        c = center[owner[i]]
        distance_out[i] = math.sqrt(far_corner2(micro.corner, i, c[0], c[1], c[2])) if owner[i] >= 0 else np.inf


@jit
def longest_edges(corner: Array, longest_out: Array) -> None:
    """Compute the longest edge [m] of each triangle, shape (M, 9)."""
    for i in range(corner.shape[0]):
        longest_out[i] = math.sqrt(longest_edge(triangle_at(corner, i))[1])


@jit_allocating
def spare_spheres(
    candidates: Indices, first: Indices, order: Indices, second_owner: Indices, most: int, spared_out: NDArray[np.bool_]
) -> int:
    """Mark up to `most` spheres to remove; no micro-triangle loses both its best and its second. Returns the number.

    Candidates are in order of preference; first and order are as of `sphere_descent.move_spheres`.
    """
    needed = np.zeros(spared_out.shape[0], np.bool_)
    spared_out[:] = False
    count = 0
    for j in candidates:
        if count >= most:
            break
        possible = not needed[j]
        for k in range(first[j], first[j + 1]):
            possible = possible and not spared_out[second_owner[order[k]]]
        if possible:
            for k in range(first[j], first[j + 1]):
                needed[second_owner[order[k]]] = True
            spared_out[j] = True
            count += 1
    return count
