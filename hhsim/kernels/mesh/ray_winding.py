"""Winding number of closed triangles around a point, counted along rays.

It is the number of triangles that a ray leaves through less those it enters through. It is needed where the nearest
triangle says inside, which holds only if no triangles cut through each other (Bærentzen and Aanæs, 2005). A ray that
meets an edge may count wrong; so three of them vote.
"""

import math

from hhsim.kernels.jit import Array, Indices, jit
from hhsim.kernels.mesh.features import BRANCHING, NOWHERE, FaceSpheres, block_distance
from hhsim.kernels.round_cone_distance import RoundCone
from hhsim.kernels.triangle import ray_crossing

DIRECTIONS = ((9 / 25, 12 / 25, 20 / 25), (-96 / 125, 75 / 125, 28 / 125), (2 / 7, -6 / 7, -3 / 7))
"""Unit vectors, none along an axis or in a coordinate plane."""


@jit
def is_surrounded(
    spheres: FaceSpheres, corner: Array, multiplicity: Indices, x: float, y: float, z: float, stack: Indices
) -> bool:
    """Return True if closed triangles of `MeshFeatures` surround a point [m]; `stack` has shape (STACK_SIZE,)."""
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
                    continue
                along, facing = ray_crossing(corner[-1 - child], x, y, z, dx, dy, dz)
                if along > 0.0:
                    times += multiplicity[-1 - child] * (-1 if facing > 0.0 else 1)
        votes += 1 if times > 0 else 0
    return votes >= 2
