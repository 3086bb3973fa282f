"""Triangles that touch or cross others than their neighbours."""

import numpy as np

from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.mesh.feature_distance import ON, triangle_distance
from hhsim.kernels.mesh.features import ALONG, BRANCHING, FaceSpheres, gather_faces
from hhsim.kernels.round_cone_distance import RoundCone
from hhsim.kernels.sphere_tree import STACK_SIZE


@jit
def _leads_into(face: Array, f: int, k: int, ux: float, uy: float, uz: float) -> bool:
    # Whether a direction from corner k of face f leads along the face, between its two sides there or on one of them.
    n = face[f]
    along = abs(n[0] * ux + n[1] * uy + n[2] * uz) <= ALONG
    for side in (k, (k + 2) % 3):
        i = 4 + 4 * side
        along = along and n[i] * ux + n[i + 1] * uy + n[i + 2] * uz >= -ALONG
    return along


@jit_allocating
def touches_itself(
    spheres: FaceSpheres, corner: Array, face: Array, corners: Indices, line: Array, ends: Indices
) -> bool:
    """Whether any edge touches or crosses a triangle other than those that it is a side of.

    Closed triangles that cut through each other, or lie on each other, do so along an edge of one of them at least.
    What is nearer than `ON` touches.

    Args:
        spheres: Around the triangles.
        corner: a, b, c of each triangle [m], shape (F, 9).
        face: As in `MeshFeatures`, shape (F, 16).
        corners: Vertices of each triangle; what is at one place is one vertex, shape (F, 3).
        line: The edges, as in `MeshFeatures`, shape (E, 7).
        ends: Their vertices, shape (E, 2).
    """
    found = np.empty(face.shape[0] + BRANCHING, np.int64)
    stack, near = np.empty(STACK_SIZE, np.int64), np.empty(BRANCHING)
    for e in range(line.shape[0]):
        x, y, z, ux, uy, uz, length = line[e]
        cone = RoundCone(x, y, z, ux, uy, uz, length, 0.0, 1.0 / length, 0.0, 0.0)
        count, _, _ = gather_faces(spheres, cone, ON, ON, stack, near, found)
        for i in range(count):
            f = found[i]
            first, second = -1, -1
            for k in range(3):
                first = k if corners[f, k] == ends[e, 0] else first
                second = k if corners[f, k] == ends[e, 1] else second
            if first >= 0 and second >= 0:
                continue
            if first >= 0:
                meets = _leads_into(face, f, first, ux, uy, uz)
            elif second >= 0:
                meets = _leads_into(face, f, second, -ux, -uy, -uz)
            else:
                meets = triangle_distance(corner, face, f, cone)[0] <= ON
            if meets:
                return True
    return False
