"""Proof that spheres cover a mesh, by triangles cut fine enough for one sphere each.

Micro-triangles: the faces of a mesh cut fine enough to assign each whole to one sphere of a cover.

The proof is a list of codes, face after face. Each face is a binary tree of triangles in preorder. A code j ≥ 0 ends a
branch: the three corners of that triangle lie in sphere j. A code −1 − k halves it at the middle m of the edge from its
corner k to the next one. With the corners rotated so that this is the edge a b, the halves follow: (a, m, c), whole,
then (m, b, c).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.kd_tree import build_median_tree
from hhsim.kernels.triangle import halve_triangle, longest_edge, middle_of_box, radius_around, triangle_at

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
def cut_faces(corner: Array, edge: float, corner_out: Array, face_out: Indices) -> int:
    """Halve faces across their longest edge until no edge is longer than `edge` [m].

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
            if length2 <= edge * edge or top + 2 > CUT_STACK:
                if count < face_out.shape[0]:
                    for k in range(9):
                        corner_out[count, k] = stack[top, k]
                    face_out[count] = face
                count += 1
                continue
            halve_triangle(triangle, longest, stack[top : top + 2])
            top += 2
    return count


@jit
def _node_spheres(
    corner: Array, order: Indices, start: Indices, end: Indices, center_out: Array, radius_out: Array
) -> None:
    """Compute spheres around the triangles order[start:end] of each node, about the middle of their box."""
    for node in range(start.shape[0]):
        middle_of_box(corner, order, start[node], end[node], center_out[node])
        radius_out[node] = radius_around(corner, order, start[node], end[node], center_out[node])


def cut_mesh(corner: Array, normal: Array, target: int) -> MicroTriangles:
    """Cut faces, shape (F, 9), with outward unit normals, shape (F, 3), into about `target` micro-triangles.

    No edge is then longer than another length, the same for all; faces that are already smaller stay whole.
    """
    ab, ac = corner[:, 3:6] - corner[:, :3], corner[:, 6:] - corner[:, :3]
    area = 0.5 * np.linalg.norm(np.cross(ab, ac), axis=1)
    edge = 2.0 * math.sqrt(float(area.sum()) / target)
    for trial in range(_CUT_TRIALS + 1):
        count = cut_faces(corner, edge, np.empty((0, 9)), np.empty(0, np.int64))
        if 0.85 * target <= count <= 1.15 * target or count == len(corner) or trial == _CUT_TRIALS:
            break
        edge *= float(np.clip(np.sqrt(count / target), 0.5, 2.0))
    micro, face = np.empty((count, 9)), np.empty(count, np.int64)
    cut_faces(corner, edge, micro, face)

    order, start, end, right = build_median_tree(micro.reshape(-1, 3, 3).mean(axis=1), _BLOCK)
    center, radius = np.empty((len(start), 3)), np.empty(len(start))
    _node_spheres(micro, order, start, end, center, radius)
    of_face = np.ascontiguousarray(normal[face[order]])
    return MicroTriangles(np.ascontiguousarray(micro[order]), of_face, start, end, right, center, radius)


@jit
def _halve_pairs(pair: Indices, corner: Array) -> None:
    """Make the halves of a triangle of each pair of its copies at i and i + 1; in place."""
    for i in pair:
        triangle = triangle_at(corner, i)
        halve_triangle(triangle, longest_edge(triangle)[0], corner[i : i + 2])


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


Codes = NDArray[np.int32]


@jit_allocating
def certify_cover(
    corner: Array, center: Array, radius: Array, slack: float, finest: float, uncovered_out: Indices, proof_out: Codes
) -> tuple[int, int]:
    """Prove for each face that it lies in the union of the spheres.

    A triangle whose three corners lie in one sphere lies in it, since spheres are convex. Any other is halved across
    its longest edge and both halves are proved. Only spheres that reach the triangle are handed down to its halves.

    Corners are a, b, c of the faces [m], shape (F, 9). A corner must lie `slack` [m] inside a sphere, which covers the
    rounding; below the edge length `finest` [m] a triangle is given up and its face uncovered. Returns the number of
    faces without a proof, the first of `uncovered_out`, and of codes; codes that do not fit are counted but not stored.
    """
    spheres = radius.shape[0]
    triangle = np.empty((CUT_STACK, 9))
    level = np.empty(CUT_STACK, np.int64)
    # lists[l] holds the spheres that reach the triangle at depth l of the path that is being walked.
    lists = np.empty((CUT_STACK, spheres), np.int64)
    length = np.empty(CUT_STACK, np.int64)
    for j in range(spheres):
        lists[0, j] = j
    length[0] = spheres
    unproved = codes = 0
    for face in range(corner.shape[0]):
        for k in range(9):
            triangle[0, k] = corner[face, k]
        level[0] = 1
        top = 1
        proved = True
        while top > 0 and proved:
            top -= 1
            t, corners = triangle[top], triangle_at(triangle, top)
            ax, ay, az, bx, by, bz, cx, cy, cz = corners
            depth = level[top]
            mx, my, mz = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
            extent = 0.0
            for v in range(0, 9, 3):
                extent = max(extent, (t[v] - mx) ** 2 + (t[v + 1] - my) ** 2 + (t[v + 2] - mz) ** 2)
            extent = math.sqrt(extent)
            count = 0
            owner = -1
            for k in range(length[depth - 1]):
                j = lists[depth - 1, k]
                x, y, z, r = center[j, 0], center[j, 1], center[j, 2], radius[j] - slack
                reach = extent + radius[j]
                if (mx - x) ** 2 + (my - y) ** 2 + (mz - z) ** 2 > reach * reach:
                    continue
                far2 = 0.0
                for v in range(0, 9, 3):
                    far2 = max(far2, (t[v] - x) ** 2 + (t[v + 1] - y) ** 2 + (t[v + 2] - z) ** 2)
                if r >= 0.0 and far2 <= r * r:
                    owner = j
                    break
                lists[depth, count] = j
                count += 1
            longest, length2 = longest_edge(corners)
            if codes < proof_out.shape[0]:
                proof_out[codes] = owner if owner >= 0 else -1 - longest
            codes += 1
            if owner >= 0:
                continue
            length[depth] = count
            if count == 0 or length2 < finest * finest or depth + 1 >= CUT_STACK:
                proved = False
                continue
            halve_triangle(corners, longest, triangle[top : top + 2])
            level[top] = level[top + 1] = depth + 1
            top += 2
        if not proved:
            uncovered_out[unproved] = face
            unproved += 1
    return unproved, codes
