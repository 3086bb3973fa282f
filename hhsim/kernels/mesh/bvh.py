"""Bounding-volume hierarchy of a mesh: closest points, signed distances and winding numbers.

Generalized winding number of a surface, closed or not.

It is the signed solid angle of all triangles over 4π (Jacobson, Kavan, Sorkine-Hornung 2013, "Robust inside-outside
segmentation using generalized winding numbers"): 1 inside and 0 outside a closed surface, in between near a hole, 2 or
−1 where pieces overlap or are inside out. Triangles far away count together, after Barill, Dickson, Schmidt, Levin and
Jacobson, "Fast winding numbers for soups and clouds" (2018): a node with triangles within R of its centre is expanded,
to second order, for points beyond `FAR_FIELD`·R.

Bounding-volume hierarchy over the triangles of a mesh: exact closest point and signed distance.

The sign, negative inside, is that of the angle-weighted pseudonormal of the closest feature (Bærentzen and Aanæs,
2005): exact for a watertight mesh that does not intersect itself. For one that does, it can be that of the winding
number.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from hhsim.kernels.arithmetic import arc_tangent, arc_tangents
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating, jit_inline
from hhsim.kernels.kd_tree import STACK, build_median_tree
from hhsim.kernels.triangle import Triangle, closest_on_triangle, far_corner2, triangle_at

SMALL = 1.0e-100
FAR_FIELD = 2.0
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
            farthest2 = max(farthest2, far_corner2(bvh.corner, i, center[0], center[1], center[2]))
            for k in range(3):
                moment[k] += vector[i, k]
                for j in range(3):
                    moment[3 + 3 * j + k] += (middle[i, j] - center[j]) * vector[i, k]
        moments.radius[node] = math.sqrt(farthest2)


@jit
def winding_at(bvh: Any, x: float, y: float, z: float, stack: Indices) -> float:
    """Compute the winding number [-] of a `MeshBvh` at one point [m], with a stack of shape (STACK,)."""
    moments = bvh.moments
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
        reach = FAR_FIELD * moments.radius[node]
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
def _fast_winding_numbers(bvh: Any, points: Array, winding_out: Array) -> None:
    stack = np.empty(STACK, np.int64)
    for i in range(points.shape[0]):
        winding_out[i] = winding_at(bvh, points[i, 0], points[i, 1], points[i, 2], stack)


def fast_winding_numbers(bvh: Any, points: Array) -> Array:
    """Compute the winding numbers [-] of a `MeshBvh` built by winding at points [m], shape (n, 3); shape (n,)."""
    winding = np.empty(len(points))
    _fast_winding_numbers(bvh, np.ascontiguousarray(points, np.float64), winding)
    return winding


_LEAF_TRIANGLES = 4


class MeshBvh(NamedTuple):
    """F triangles in tree order, and the tree of N nodes over them.

    A node's bound is the lowest and the highest corner of a box [m], and a slab: its unit normal n, the mean of the
    faces' (zero if they have none), and the least and largest n · x [m].
    """

    corner: Array  # a, b, c of each triangle [m], (F, 9)
    pseudonormal: Array  # outward, by feature of `closest_on_triangle`, not of unit length, (F, 7, 3)
    face: Indices  # index in the mesh, (F,)
    bound: Array  # (N, 11)
    start: Indices  # with the next two as in `MedianTree`, (N,)
    end: Indices
    right: Indices
    moments: WindingMoments  # of the N nodes if the winding number gives the sign, else of none


def face_normals(vertices: Array, faces: Indices) -> Array:
    """Compute outward unit normals, shape (F, 3); zero for a face without area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1)
    return np.asarray(normal / np.where(length > 0.0, length, 1.0)[:, None])


def pseudonormals(vertices: Array, faces: Indices) -> Array:
    """Compute outward angle-weighted normals, not of unit length, by feature, shape (F, 7, 3)."""
    normal = face_normals(vertices, faces)
    result = np.empty((len(faces), 7, 3))
    result[:, 0] = normal

    at_vertex = np.zeros_like(vertices)
    for k in range(3):
        out = vertices[faces[:, (k + 1) % 3]] - vertices[faces[:, k]]
        back = vertices[faces[:, (k + 2) % 3]] - vertices[faces[:, k]]
        angle = np.empty(len(faces))
        arc_tangents(np.linalg.norm(np.cross(out, back), axis=1), (out * back).sum(axis=1), angle)
        np.add.at(at_vertex, faces[:, k], angle[:, None] * normal)
    result[:, 1:4] = at_vertex[faces]

    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    _, edge = np.unique(ends[:, 0] * np.int64(len(vertices)) + ends[:, 1], return_inverse=True)
    at_edge = np.zeros((int(edge.max()) + 1, 3))
    np.add.at(at_edge, edge, np.repeat(normal, 3, axis=0))
    result[:, 4:7] = at_edge[edge].reshape(-1, 3, 3)
    return result


def build_mesh_bvh(vertices: Array, faces: Indices, signed: bool = True, by_winding: bool = False) -> MeshBvh:
    """Build the hierarchy over vertices [m], shape (V, 3), and faces, outward by the right hand, shape (F, 3), F ≥ 1.

    Unless `signed` the pseudonormals are 0, which saves most of the time: nothing is then outside. With `by_winding`
    the winding number gives the sign, also where triangles cross each other.
    """
    corners = np.ascontiguousarray(vertices[faces], np.float64)
    tree = build_median_tree(corners.mean(axis=1), _LEAF_TRIANGLES)
    corners = corners[tree.order]
    bound = np.empty((len(tree.start), 11))
    corner = np.ascontiguousarray(corners.reshape(-1, 9))
    _bound(corner, tree.start, tree.end, tree.right, bound)
    normal = pseudonormals(vertices, faces)[tree.order] if signed else np.zeros((len(faces), 7, 3))
    nodes = len(tree.start) if by_winding else 0
    moments = WindingMoments(np.empty((nodes, 3)), np.empty(nodes), np.empty((nodes, 12)))
    bvh = MeshBvh(corner, np.ascontiguousarray(normal), tree.order, bound, tree.start, tree.end, tree.right, moments)
    if by_winding:
        _sum_moments(bvh, moments)
    return bvh


@jit_allocating
def _bound(corner: Array, start: Indices, end: Indices, right: Indices, bound_out: Array) -> None:
    """Compute the bounds of the nodes; backwards, since children follow their parents in preorder."""
    normal = np.zeros((start.shape[0], 3))
    for node in range(start.shape[0] - 1, -1, -1):
        b, n = bound_out[node], normal[node]
        if right[node] < 0:
            for k in range(3):
                b[k], b[3 + k] = np.inf, -np.inf
            for i in range(start[node], end[node]):
                t = corner[i]
                for k in range(3):
                    b[k] = min(b[k], min(t[k], min(t[3 + k], t[6 + k])))
                    b[3 + k] = max(b[3 + k], max(t[k], max(t[3 + k], t[6 + k])))
                ux, uy, uz = t[3] - t[0], t[4] - t[1], t[5] - t[2]
                vx, vy, vz = t[6] - t[0], t[7] - t[1], t[8] - t[2]
                n[0] += uy * vz - uz * vy
                n[1] += uz * vx - ux * vz
                n[2] += ux * vy - uy * vx
        else:
            left, other = bound_out[node + 1], bound_out[right[node]]
            for k in range(3):
                b[k], b[3 + k] = min(left[k], other[k]), max(left[3 + k], other[3 + k])
                n[k] = normal[node + 1, k] + normal[right[node], k]
        length = math.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        b[6] = b[7] = b[8] = b[9] = b[10] = 0.0
        if length > 0.0:
            b[6], b[7], b[8], b[9], b[10] = n[0] / length, n[1] / length, n[2] / length, np.inf, -np.inf
            for i in range(start[node], end[node]):
                for v in range(0, 9, 3):
                    height = b[6] * corner[i, v] + b[7] * corner[i, v + 1] + b[8] * corner[i, v + 2]
                    b[9], b[10] = min(b[9], height), max(b[10], height)


@jit_inline
def _least_distance2(bound: Array, node: int, px: float, py: float, pz: float) -> float:
    """Compute the larger squared distance [m²] of p from a node's box and slab.

    A tangential face reaches into a sphere by its slab's thickness, which shrinks with the square of its size, but its
    box by its size: on fine meshes the slab refuses what the box lets through.
    """
    b = bound[node]
    dx = max(max(b[0] - px, px - b[3]), 0.0)
    dy = max(max(b[1] - py, py - b[4]), 0.0)
    dz = max(max(b[2] - pz, pz - b[5]), 0.0)
    height = b[6] * px + b[7] * py + b[8] * pz
    across = max(max(b[9] - height, height - b[10]), 0.0)
    return float(max(dx * dx + dy * dy + dz * dz, across * across))


@jit
def closest_on_mesh(
    bvh: MeshBvh, px: float, py: float, pz: float, limit2: float, stack: Indices, stack_distance2: Array
) -> tuple[int, float, float, float, float, int]:
    """Compute the closest point of the mesh to p [m], if it is nearer than √limit2.

    The stacks are workspace of shape (STACK,). Returns (triangle, x, y, z, distance², feature), the triangle in the
    order of the BVH, −1 if none is nearer than the limit.
    """
    best = limit2
    triangle, feature = -1, 0
    x = y = z = 0.0
    stack[0] = 0
    stack_distance2[0] = _least_distance2(bvh.bound, stack[0], px, py, pz)
    top = 1
    while top > 0:
        top -= 1
        if stack_distance2[top] >= best:
            continue
        node = stack[top]
        right = bvh.right[node]
        if right < 0:
            for i in range(bvh.start[node], bvh.end[node]):
                qx, qy, qz, d2, f = closest_on_triangle(px, py, pz, triangle_at(bvh.corner, i))
                if d2 < best:
                    best = d2
                    x, y, z, triangle, feature = qx, qy, qz, i, f
        else:
            near, far = node + 1, right
            near2 = _least_distance2(bvh.bound, near, px, py, pz)
            far2 = _least_distance2(bvh.bound, far, px, py, pz)
            if far2 < near2:
                near, far, near2, far2 = far, near, far2, near2
            if far2 < best:
                stack[top], stack_distance2[top] = far, far2
                top += 1
            if near2 < best:
                stack[top], stack_distance2[top] = near, near2
                top += 1
    return triangle, x, y, z, best, feature


@jit_inline
def outside(bvh: MeshBvh, triangle: int, feature: int, dx: float, dy: float, dz: float) -> bool:
    """Return True if a point lies outside, (dx, dy, dz) from its closest point on `triangle`."""
    n = bvh.pseudonormal[triangle, feature]
    return bool(n[0] * dx + n[1] * dy + n[2] * dz > 0.0)


@jit
def beyond(bvh: MeshBvh, x: float, y: float, z: float) -> bool:
    """Return True if a point lies beyond the box of all triangles: outside, also of a mesh that intersects itself."""
    b = bvh.bound[0]
    return bool(x < b[0] or x > b[3] or y < b[1] or y > b[4] or z < b[2] or z > b[5])


@jit
def signed_distance(
    bvh: MeshBvh, px: float, py: float, pz: float, stack: Indices, stack_distance2: Array
) -> tuple[float, float, float, float]:
    """Compute the signed distance [m] of one point, negative inside, and the closest point of the mesh (x, y, z)."""
    triangle, x, y, z, d2, feature = closest_on_mesh(bvh, px, py, pz, np.inf, stack, stack_distance2)
    distance, inside = math.sqrt(d2), False
    if not beyond(bvh, px, py, pz):
        if bvh.moments.radius.shape[0] > 0:
            inside = winding_at(bvh, px, py, pz, stack) > 0.5
        else:
            inside = triangle >= 0 and not outside(bvh, triangle, feature, px - x, py - y, pz - z)
    return -distance if inside else distance, x, y, z


@jit_allocating
def closest_points(bvh: MeshBvh, points: Array, closest_out: Array, signed_distance_out: Array) -> None:
    """Compute closest points on the mesh [m], shape (n, 3), and signed distances [m] of points, shape (n, 3)."""
    stack, stack_distance2 = np.empty(STACK, np.int64), np.empty(STACK)
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        signed_distance_out[i], x, y, z = signed_distance(bvh, px, py, pz, stack, stack_distance2)
        closest_out[i, 0], closest_out[i, 1], closest_out[i, 2] = x, y, z


def mesh_signed_distance(bvh: MeshBvh, points: Array) -> Array:
    """Compute signed distances [m] of points, shape (n, 3), to the mesh; negative inside."""
    points = np.ascontiguousarray(points, np.float64)
    closest, signed = np.empty((len(points), 3)), np.empty(len(points))
    closest_points(bvh, points, closest, signed)
    return signed
