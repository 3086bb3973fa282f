"""How often closed triangles go around a point, counted along rays.

A ray comes out of closed triangles as often, less the times that it goes in, as they go around its start: their
winding number. It is asked where the nearest triangle says inside, since that is true only of triangles that nowhere
cut through each other (Bærentzen and Aanæs, 2005). A ray that meets an edge counts wrong; so three of them vote.
"""

import math

from hhsim.kernels.jit import Array, Indices, jit, jit_inline
from hhsim.kernels.mesh.features import BRANCHING, NOWHERE, FaceSpheres, block_distance
from hhsim.kernels.round_cone_distance import RoundCone

DIRECTIONS = ((9 / 25, 12 / 25, 20 / 25), (-96 / 125, 75 / 125, 28 / 125), (2 / 7, -6 / 7, -3 / 7))
"""Unit vectors, along no axis and in no plane of two."""


@jit_inline
def _comes_out(c: Array, x: float, y: float, z: float, dx: float, dy: float, dz: float) -> int:
    # 1 where the ray meets a triangle (9,) from behind, -1 from the front, 0 where it passes (Möller, Trumbore 1997).
    ux, uy, uz = c[3] - c[0], c[4] - c[1], c[5] - c[2]
    vx, vy, vz = c[6] - c[0], c[7] - c[1], c[8] - c[2]
    hx, hy, hz = dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx
    det = ux * hx + uy * hy + uz * hz
    if det == 0.0:
        return 0
    sx, sy, sz = x - c[0], y - c[1], z - c[2]
    a = (sx * hx + sy * hy + sz * hz) / det
    qx, qy, qz = sy * uz - sz * uy, sz * ux - sx * uz, sx * uy - sy * ux
    b = (dx * qx + dy * qy + dz * qz) / det
    along = (vx * qx + vy * qy + vz * qz) / det
    if not (a >= 0.0 and b >= 0.0 and a + b <= 1.0 and along > 0.0):
        return 0
    return -1 if det > 0.0 else 1


@jit
def is_surrounded(
    spheres: FaceSpheres, corner: Array, multiplicity: Indices, x: float, y: float, z: float, stack: Indices
) -> bool:
    """Whether closed triangles go around a point at least once.

    Args:
        spheres: Around the triangles.
        corner: Theirs [m], shape (F, 9).
        multiplicity: As in `MeshFeatures`, shape (F,).
        x, y, z: The point [m].
        stack: Workspace, shape (STACK_SIZE,).
    """
    root, farthest = spheres.block[0], 0.0
    for i in range(BRANCHING):
        if root[0, i] < NOWHERE:
            away = (root[0, i] - x) ** 2 + (root[1, i] - y) ** 2 + (root[2, i] - z) ** 2
            farthest = max(farthest, math.sqrt(away) + root[3, i])
    votes = 0
    for dx, dy, dz in DIRECTIONS:
        ray = RoundCone(x, y, z, dx, dy, dz, 2.0 * farthest, 0.0, 0.0, 0.0, 0.0)
        times = 0
        stack[0] = 0
        top = 1
        while top > 0:
            top -= 1
            node = stack[top]
            for i in range(BRANCHING):
                if not block_distance(spheres.block, node, i, ray) <= 0.0:
                    continue
                child = spheres.child[node, i]
                if child >= 0:
                    stack[top] = child
                    top += 1
                else:
                    times += multiplicity[-1 - child] * _comes_out(corner[-1 - child], x, y, z, dx, dy, dz)
        votes += 1 if times > 0 else 0
    return votes >= 2
