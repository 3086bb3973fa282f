"""Corners, edges and faces of a mesh for contacts, and the spheres that find them.

A body touches a mesh at its *features*: the inside of a face, the inside of an edge, a vertex. The least distance of a
body to the mesh is the least of its distances to the features, each where its witness lies on the feature itself, and
there the line to the body lies in the feature's *normal cone*: along a face's normal, between the two normals at an
edge, away from every edge at a vertex (Johnson, Willemsen and Cohen, Six-degree-of-freedom haptic rendering using
spatialized normal cone search, 2005). No inside is needed for it: a sheet is touched from both sides.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hhsim.kernels.by_reference import by_reference
from hhsim.kernels.jit import Array, Indices, jit, jit_allocating
from hhsim.kernels.kd_tree import split_widest
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.kernels.triangle import middle_of_box, radius_around

BRANCHING = 8
ALONG = 1e-9
"""Sine below which an angle counts as zero."""
FACE_FIELDS = 16
"""Number of values of a face: its unit normal n and n · x on it, then for each side the unit normal m in the plane,
inward, and the least m · x that counts as inside [m]: a little less than on the side itself."""
EDGE_FIELDS = 7
"""Number of values of an edge: its first end [m], the unit vector along it, its length [m]."""


@by_reference
class MeshFeatures(NamedTuple):
    """A mesh of F faces, E edges and V vertices that can be touched, world.

    Each edge and each vertex belongs to one of its faces, so that a walk that finds the faces finds it once. Edges
    between coplanar faces are left out. Two arrays may have no rows: `multiplicity`, if there is no inside, and
    `pseudonormal`, if both sides are touched.
    """

    tree: TreeArrays  # spheres around the faces and around groups of them; piece i is face i
    corner: Array  # a, b, c of each face [m], (F, 9)
    face: Array  # see `FACE_FIELDS`, (F, 16)
    face_edge: Indices  # edges that belong to the face, -1 for none, (F, 3)
    face_vertex: Indices  # vertices that belong to the face, -1 for none, (F, 3)
    face_across: Indices  # face that continues the plane beyond each side, -1 for none, (F, 3)
    edge: Array  # see `EDGE_FIELDS`, (E, 7)
    wing_start: Indices  # first wing of each edge, and the end, (E + 1,)
    wing: Array  # unit vectors from an edge into its faces, across the edge, (·, 3)
    wing_face: Indices  # the face of each wing, (·,)
    vertex: Array  # [m], (V, 3)
    spoke_start: Indices  # first spoke of each vertex, and the end, (V + 1,)
    spoke: Array  # unit vectors from a vertex along its edges, (·, 3)
    spoke_edge: Indices  # the edge of each spoke, (·,)
    multiplicity: Indices  # number of copies of a face, less those wound the other way, (F,)
    pseudonormal: Array  # outward, by feature of `closest_on_triangle`, (F, 7, 3)


@jit
def _triangle_sphere(corner: Array, center_out: Array) -> None:
    """Compute the least sphere around a triangle: over its longest side, or if it is acute the circumscribed one."""
    best, first = -1.0, 0
    for k in range(3):
        i, j = 3 * k, 3 * ((k + 1) % 3)
        square = 0.0
        for m in range(3):
            square += (corner[i + m] - corner[j + m]) ** 2
        if square > best:
            best, first = square, k
    i, j, o = 3 * first, 3 * ((first + 1) % 3), 3 * ((first + 2) % 3)
    # With u, v from the corner off the longest side to its ends.
    uu, vv, uv = 0.0, 0.0, 0.0
    for m in range(3):
        u, v = corner[i + m] - corner[o + m], corner[j + m] - corner[o + m]
        uu += u * u
        vv += v * v
        uv += u * v
    area2 = uu * vv - uv * uv
    if uv <= 0.0 or not area2 > 0.0:
        p, q = 0.5, 0.5
    else:
        p, q = 0.5 * vv * (uu - uv) / area2, 0.5 * uu * (vv - uv) / area2
    for m in range(3):
        u, v = corner[i + m] - corner[o + m], corner[j + m] - corner[o + m]
        center_out[m] = corner[o + m] + p * u + q * v


@jit
def _children(faces: int) -> int:
    # The fewest that hold the faces in full groups: halved three times at every level, most of the last groups would
    # have two or three.
    most = 1
    while most * BRANCHING < faces:
        most *= BRANCHING
    return (faces + most - 1) // most


@jit_allocating
def face_tree(corner: Array) -> TreeArrays:
    """Build spheres around faces, shape (F, 9), in groups of up to eight, split across the widest axis.

    The groups of faces are nearly full for any F; those at the top need not be.
    """
    faces = corner.shape[0]
    middle = np.empty((3, faces))
    for i in range(faces):
        for m in range(3):
            middle[m, i] = (corner[i, m] + corner[i, 3 + m] + corner[i, 6 + m]) / 3.0
    order = np.arange(faces)
    # A group of groups has at least two, and one of faces four, unless it is the only one.
    most = faces + faces // 2 + 1
    sphere, first_child, child_count = np.empty((4, most)), np.empty(most, np.int64), np.zeros(most, np.int64)
    start, end = np.empty(most, np.int64), np.empty(most, np.int64)
    share = np.empty(BRANCHING, np.int64)
    center = np.empty(3)
    start[0], end[0] = 0, faces
    nodes, node = 1, 0
    while node < nodes:
        low, high = start[node], end[node]
        if high - low == 1:
            _triangle_sphere(corner[order[low]], center)
            first_child[node] = -1 - order[low]
        else:
            middle_of_box(corner, order, low, high, center)
            first_child[node], child_count[node] = nodes, 1
            start[nodes], end[nodes], share[0] = low, high, _children(high - low)
            i = 0
            while i < child_count[node]:
                # A piece of several children is split, and its first half visited again; the pieces stay in order.
                if share[i] == 1:
                    i += 1
                    continue
                low, high, first = start[nodes + i], end[nodes + i], share[i] // 2
                place = low + (high - low) * first // share[i]
                split_widest(middle, order, low, high, place)
                for j in range(child_count[node], i, -1):
                    start[nodes + j], end[nodes + j], share[j] = start[nodes + j - 1], end[nodes + j - 1], share[j - 1]
                end[nodes + i] = start[nodes + i + 1] = place
                share[i], share[i + 1] = first, share[i] - first
                child_count[node] += 1
            nodes += child_count[node]
        for m in range(3):
            sphere[m, node] = center[m]
        sphere[3, node] = radius_around(corner, order, start[node], end[node], center)
        node += 1
    x, y, z, radius = sphere[0, :nodes].copy(), sphere[1, :nodes].copy(), sphere[2, :nodes].copy(), sphere[3, :nodes]
    return TreeArrays(x, y, z, radius.copy(), first_child[:nodes].copy(), child_count[:nodes].copy())


@jit
def touchable_vertices(spoke_start: Indices, spoke: Array, outward: Array, touchable_out: NDArray[np.bool_]) -> None:
    """Mark the vertices that have a normal cone: a direction that leads away from all of their edges.

    A cone that is not empty has a direction across two of the edges, or is a half space or a wedge. `outward` are the
    vertices' normals, shape (V, 3), if only the outside is touched, else it has no rows.
    """
    for v in range(spoke_start.shape[0] - 1):
        first, last = spoke_start[v], spoke_start[v + 1]
        found = last - first < 3
        for i in range(first, last):
            for j in range(first, i):
                x = spoke[i, 1] * spoke[j, 2] - spoke[i, 2] * spoke[j, 1]
                y = spoke[i, 2] * spoke[j, 0] - spoke[i, 0] * spoke[j, 2]
                z = spoke[i, 0] * spoke[j, 1] - spoke[i, 1] * spoke[j, 0]
                size = math.sqrt(x * x + y * y + z * z)
                # Parallel edges have no single direction across both.
                found = found or size < ALONG
                for side in (-1.0, 1.0):
                    if found or (
                        outward.shape[0] > 0
                        and side * (x * outward[v, 0] + y * outward[v, 1] + z * outward[v, 2]) <= 0.0
                    ):
                        continue
                    away = True
                    for k in range(first, last):
                        rise = side * (x * spoke[k, 0] + y * spoke[k, 1] + z * spoke[k, 2])
                        away = away and rise <= ALONG * size
                    found = found or away
        touchable_out[v] = found
