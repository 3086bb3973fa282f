"""Proof that spheres cover a mesh.

The proof is a list of codes, face after face. Each face is a binary tree of triangles in preorder. A code j ≥ 0 ends a
branch: the three corners of that triangle lie in sphere j. A code −1 − k halves it at the middle m of the edge from its
corner k to the next one. With the corners rotated so that this is the edge a b, the halves follow: (a, m, c), whole,
then (m, b, c).
"""

import math

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.cover.micro_triangle import CUT_STACK
from hhsim.kernels.jit import Array, Indices, jit_allocating
from hhsim.kernels.triangle import halve_triangle, longest_edge, triangle_at

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
