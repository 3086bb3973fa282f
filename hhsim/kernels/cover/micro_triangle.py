"""Micro-triangles: the faces of a mesh cut fine enough to assign each whole to one sphere of a cover."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.kd_tree import build_median_tree
from hhsim.kernels.triangle import halve_triangle, longest_edge, triangle_at

CUT_STACK = 256
"""Size of the stack of `cut_faces`: a halved triangle leaves one waiting, and 256 halvings end below any float."""

_BLOCK = 8
_CUT_TRIALS = 12


class MicroTriangles(NamedTuple):
    """Micro-triangles in spatial order, and a median tree over them whose leaves are blocks of at most 8."""

    corner: Array  # a, b, c [m], (M, 9)
    normal: Array  # outward unit normal of the face, zero without area, (M, 3)
    start: Indices  # with the next two as in `MedianTree`, (N,)
    end: Indices
    right: Indices
    center: Array  # of the sphere around a node [m], (N, 3)
    radius: Array  # [m], (N,)


@jit_allocating
def cut_faces(corner: Array, edge: Array, corner_out: Array, face_out: Indices) -> int:
    """Halve faces across their longest edge until no edge is longer than `edge` [m], shape (F,), allows.

    Writes the micro-triangles [m] and the face of each, as many as fit; returns the number of all.
    """
    stack = np.empty((CUT_STACK, 9))
    count = 0
    for face in range(corner.shape[0]):
        for k in range(9):
            stack[0, k] = corner[face, k]
        top = 1
        while top > 0:
            top -= 1
            triangle = triangle_at(stack, top)
            longest, length2 = longest_edge(triangle)
            if length2 <= edge[face] * edge[face] or top + 2 > CUT_STACK:
                if count < face_out.shape[0]:
                    for k in range(9):
                        corner_out[count, k] = stack[top, k]
                    face_out[count] = face
                count += 1
                continue
            halve_triangle(triangle, longest, stack[top : top + 2])
            top += 2
    return count


@jit_allocating
def _node_spheres(
    corner: Array, start: Indices, end: Indices, right: Indices, center_out: Array, radius_out: Array
) -> None:
    """Compute spheres around the corners of each node, about the centre of their bounds."""
    low, high = np.empty((start.shape[0], 3)), np.empty((start.shape[0], 3))
    for node in range(start.shape[0] - 1, -1, -1):
        for k in range(3):
            if right[node] < 0:
                least, most = np.inf, -np.inf
                for i in range(start[node], end[node]):
                    for v in range(0, 9, 3):
                        least = min(least, corner[i, v + k])
                        most = max(most, corner[i, v + k])
            else:
                least = min(low[node + 1, k], low[right[node], k])
                most = max(high[node + 1, k], high[right[node], k])
            low[node, k], high[node, k] = least, most
            center_out[node, k] = 0.5 * (least + most)
        farthest2 = 0.0
        for i in range(start[node], end[node]):
            for v in range(0, 9, 3):
                dx = corner[i, v] - center_out[node, 0]
                dy = corner[i, v + 1] - center_out[node, 1]
                dz = corner[i, v + 2] - center_out[node, 2]
                farthest2 = max(farthest2, dx * dx + dy * dy + dz * dz)
        radius_out[node] = np.sqrt(farthest2) * (1.0 + 1e-12)


def edges_for(corner: Array, share: Array, target: int) -> Array:
    """Compute longest edges [m], proportional to `share` > 0 of each face, that cut faces into about `target` pieces.

    Faces, shape (F, 9), that are already smaller stay whole.
    """
    ab, ac = corner[:, 3:6] - corner[:, :3], corner[:, 6:] - corner[:, :3]
    area = 0.5 * np.linalg.norm(np.cross(ab, ac), axis=1)
    no_corner, no_face = np.empty((0, 9)), np.empty(0, np.int64)
    edge: Array = share * 2.0 * np.sqrt(float((area / share**2).sum()) / target)
    for _ in range(_CUT_TRIALS):
        count = cut_faces(corner, edge, no_corner, no_face)
        if 0.85 * target <= count <= 1.15 * target or count == len(corner):
            break
        edge *= float(np.clip(np.sqrt(count / target), 0.5, 2.0))
    return edge


def cut_mesh(corner: Array, normal: Array, edge: Array) -> MicroTriangles:
    """Cut faces, shape (F, 9), with outward unit normals, shape (F, 3), until no edge is longer than `edge` [m]."""
    count = cut_faces(corner, edge, np.empty((0, 9)), np.empty(0, np.int64))
    micro, face = np.empty((count, 9)), np.empty(count, np.int64)
    cut_faces(corner, edge, micro, face)

    tree = build_median_tree(micro.reshape(-1, 3, 3).mean(axis=1), _BLOCK)
    micro = np.ascontiguousarray(micro[tree.order])
    center, radius = np.empty((len(tree.start), 3)), np.empty(len(tree.start))
    _node_spheres(micro, tree.start, tree.end, tree.right, center, radius)
    normal = np.ascontiguousarray(normal[face[tree.order]])
    return MicroTriangles(micro, normal, tree.start, tree.end, tree.right, center, radius)


@jit
def _turn(t: Array, first: int) -> None:
    """Rotate the corners so that the one in column `first` comes first: among equal edges the first is halved."""
    for k in range(3):
        a, b, c = t[(first + k) % 9], t[(first + 3 + k) % 9], t[(first + 6 + k) % 9]
        t[k], t[3 + k], t[6 + k] = a, b, c


@jit
def _halve_pairs(pair: Indices, corner: Array) -> None:
    """Make the halves of a triangle, as `cut_faces` does, of each pair of its copies at i and i + 1; in place."""
    for i in pair:
        t, s = corner[i], corner[i + 1]
        longest, _ = longest_edge(triangle_at(corner, i))
        a, b = 3 * longest, 3 * ((longest + 1) % 3)
        for k in range(3):
            middle = 0.5 * (t[a + k] + t[b + k])
            t[a + k] = middle
            s[b + k] = middle
        _turn(t, a)
        _turn(s, a)


def halve(micro: MicroTriangles, chosen: NDArray[np.bool_]) -> tuple[MicroTriangles, Indices]:
    """Halve the chosen micro-triangles, shape (M,), across their longest edges; the tree stays, its blocks grow.

    Returns the new micro-triangles, and for each the old one that it lies in.
    """
    source = np.repeat(np.arange(len(chosen)), 1 + chosen)
    corner = micro.corner[source]
    before = np.concatenate([[0], np.cumsum(1 + chosen)])
    _halve_pairs(before[:-1][chosen], corner)
    start, end = before[micro.start], before[micro.end]
    return micro._replace(corner=corner, normal=micro.normal[source], start=start, end=end), source
