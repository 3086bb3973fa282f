"""Winding number of large meshes: triangles far away count together, by the first terms of their multipole expansion.

After Barill, Dickson, Schmidt, Levin and Jacobson, "Fast winding numbers for soups and clouds" (2018): a node of the
hierarchy whose triangles lie within R of its centre is expanded, to second order, for points beyond `FAR`·R; nearer
ones are summed exactly. See `winding.py` for the number itself.
"""

import math
from typing import NamedTuple

import numpy as np

from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.kd_tree import STACK
from hhsim.kernels.mesh.bvh import MeshBvh
from hhsim.kernels.mesh.winding_number import turned_by
from hhsim.kernels.triangle import Triangle

FAR = 2.5
"""Distance [radii of the node] from which a node is expanded: right to 0.05, and to 0.01 on average."""


class WindingMoments(NamedTuple):
    """Moments of the triangles under each node of a `MeshBvh`.

    center: (N, 3) mean of the triangles by area [m]; radius: (N,) of the sphere around it [m];
    moment: (N, 12) sum of area vectors n [m²], and of the products (centroid − center) n [m³] row by row.
    """

    center: Array
    radius: Array
    moment: Array


def winding_moments(bvh: MeshBvh) -> WindingMoments:
    """Moments for the nodes of a hierarchy."""
    nodes = len(bvh.start)
    moments = WindingMoments(np.empty((nodes, 3)), np.empty(nodes), np.empty((nodes, 12)))
    _sum_moments(bvh, moments)
    return moments


@jit_allocating
def _sum_moments(bvh: MeshBvh, moments: WindingMoments) -> None:
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
            # Without area nothing counts, wherever the centre is.
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
def winding_at(bvh: MeshBvh, moments: WindingMoments, x: float, y: float, z: float, stack: Indices) -> float:
    """Winding number [-] at one point [m].

    Args:
        bvh: Over the triangles.
        moments: Of the same.
        x, y, z: The point [m].
        stack: Workspace, shape (STACK,).
    """
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
                t = bvh.corner[i]
                corners = Triangle(t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8])
                real, imaginary, turns = turned_by(x, y, z, corners, real, imaginary, turns)
        else:
            stack[top], stack[top + 1] = bvh.right[node], node + 1
            top += 2
    return (math.atan2(imaginary, real) + 2.0 * math.pi * turns + 0.5 * far) / (2.0 * math.pi)


@jit_allocating
def fast_winding_numbers(bvh: MeshBvh, moments: WindingMoments, points: Array, winding_out: Array) -> None:
    """Winding numbers [-], shape (n,), at points [m], shape (n, 3)."""
    stack = np.empty(STACK, np.int64)
    for i in range(points.shape[0]):
        winding_out[i] = winding_at(bvh, moments, points[i, 0], points[i, 1], points[i, 2], stack)
