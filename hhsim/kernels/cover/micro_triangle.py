"""Micro-triangles: the faces of a mesh cut fine enough to be assigned whole to one sphere of a cover each."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.kd_tree import build_median_tree
from hhsim.kernels.triangle import longest_edge

CUT_STACK = 256
"""Room for the stack of `cut_faces`: a halved triangle leaves one waiting, and 256 halvings end below any float."""

_BLOCK = 8
_CUT_TRIALS = 12


class MicroTriangles(NamedTuple):
    """Micro-triangles in spatial order, and a median tree over them whose leaves are blocks of at most 8.

    corner: (M, 9) a, b, c [m]; normal: (M, 3) outward unit normal of the face (zero without area);
    start, end, right: (N,) as in `MedianTree`; center: (N, 3) and radius: (N,) spheres around the nodes [m].
    """

    corner: Array
    normal: Array
    start: Indices
    end: Indices
    right: Indices
    center: Array
    radius: Array


@jit_allocating
def cut_faces(corner: Array, edge: Array, corner_out: Array, face_out: Indices) -> int:
    """Halve triangles across their longest edge until no edge is longer than `edge` allows.

    Args:
        corner: a, b, c of the faces [m], shape (F, 9).
        edge: Longest edge [m] allowed in each face, shape (F,).
        corner_out: Micro-triangles [m], shape (room, 9); those beyond the room are counted but not stored.
        face_out: The face that each was cut from, shape (room,).

    Returns:
        How many micro-triangles there are.
    """
    stack = np.empty((CUT_STACK, 9))
    count = 0
    for face in range(corner.shape[0]):
        for k in range(9):
            stack[0, k] = corner[face, k]
        top = 1
        while top > 0:
            top -= 1
            ax, ay, az = stack[top, 0], stack[top, 1], stack[top, 2]
            bx, by, bz = stack[top, 3], stack[top, 4], stack[top, 5]
            cx, cy, cz = stack[top, 6], stack[top, 7], stack[top, 8]
            longest, length2 = longest_edge(ax, ay, az, bx, by, bz, cx, cy, cz)
            if length2 <= edge[face] * edge[face] or top + 2 > CUT_STACK:
                if count < face_out.shape[0]:
                    for k in range(9):
                        corner_out[count, k] = stack[top, k]
                    face_out[count] = face
                count += 1
                continue
            if longest == 1:
                ax, ay, az, bx, by, bz, cx, cy, cz = bx, by, bz, cx, cy, cz, ax, ay, az
            elif longest == 2:
                ax, ay, az, bx, by, bz, cx, cy, cz = cx, cy, cz, ax, ay, az, bx, by, bz
            mx, my, mz = 0.5 * (ax + bx), 0.5 * (ay + by), 0.5 * (az + bz)
            for half in range(2):
                s = stack[top + half]
                if half == 0:
                    s[0], s[1], s[2], s[3], s[4], s[5] = mx, my, mz, bx, by, bz
                else:
                    s[0], s[1], s[2], s[3], s[4], s[5] = ax, ay, az, mx, my, mz
                s[6], s[7], s[8] = cx, cy, cz
            top += 2
    return count


@jit_allocating
def _node_spheres(
    corner: Array, start: Indices, end: Indices, right: Indices, center_out: Array, radius_out: Array
) -> None:
    """Spheres around the corners of each node, about the centre of their bounds."""
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
    """Longest edges [m] allowed, proportional to `share` of each face, that cut faces into about `target` pieces.

    Args:
        corner: a, b, c of the faces [m], shape (F, 9).
        share: Positive, shape (F,).
        target: Number of micro-triangles wanted; faces that are already smaller stay whole.
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
    """Cut faces into micro-triangles.

    Args:
        corner: a, b, c of the faces [m], shape (F, 9).
        normal: Outward unit normals of the faces, shape (F, 3).
        edge: Longest edge [m] allowed in each face, shape (F,).
    """
    count = cut_faces(corner, edge, np.empty((0, 9)), np.empty(0, np.int64))
    micro, face = np.empty((count, 9)), np.empty(count, np.int64)
    cut_faces(corner, edge, micro, face)

    tree = build_median_tree(micro.reshape(-1, 3, 3).mean(axis=1), _BLOCK)
    micro = np.ascontiguousarray(micro[tree.order])
    center, radius = np.empty((len(tree.start), 3)), np.empty(len(tree.start))
    _node_spheres(micro, tree.start, tree.end, tree.right, center, radius)
    return MicroTriangles(
        micro, np.ascontiguousarray(normal[face[tree.order]]), tree.start, tree.end, tree.right, center, radius
    )


@jit
def _turn(t: Array, first: int) -> None:
    """Turn the corners so that the one in column `first` comes first: among equal edges the first is halved."""
    for k in range(3):
        a, b, c = t[(first + k) % 9], t[(first + 3 + k) % 9], t[(first + 6 + k) % 9]
        t[k], t[3 + k], t[6 + k] = a, b, c


@jit
def _halve_pairs(pair: Indices, corner: Array) -> None:
    """Make the halves of a triangle, as `cut_faces` does, of each pair of its copies at i and i + 1; in place."""
    for i in pair:
        t, s = corner[i], corner[i + 1]
        longest, _ = longest_edge(t[0], t[1], t[2], t[3], t[4], t[5], t[6], t[7], t[8])
        a, b = 3 * longest, 3 * ((longest + 1) % 3)
        for k in range(3):
            middle = 0.5 * (t[a + k] + t[b + k])
            t[a + k] = middle
            s[b + k] = middle
        _turn(t, a)
        _turn(s, a)


def halve(micro: MicroTriangles, chosen: NDArray[np.bool_]) -> tuple[MicroTriangles, Indices]:
    """Halve some micro-triangles across their longest edges; the tree stays, its blocks grow.

    Args:
        micro: The micro-triangles.
        chosen: Which to halve, shape (M,).

    Returns:
        The new micro-triangles, and for each the old one that it lies in.
    """
    source = np.repeat(np.arange(len(chosen)), 1 + chosen)
    corner = micro.corner[source]
    before = np.concatenate([[0], np.cumsum(1 + chosen)])
    _halve_pairs(before[:-1][chosen], corner)
    return (
        micro._replace(corner=corner, normal=micro.normal[source], start=before[micro.start], end=before[micro.end]),
        source,
    )
