"""What of a mesh can be touched: its faces, edges and vertices, made ready for contacts.

Any triangles will do: they may enclose nothing, meet three at an edge, lie loose. Vertices at the same place are one,
and so are those that rounding has torn apart; triangles without area, and all but one of several on the same corners,
are left out.
"""

from typing import NamedTuple

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.mesh.bvh import pseudonormals
from hhsim.kernels.mesh.covered_borders import covered_corners, covered_edges
from hhsim.kernels.mesh.feature_distance import ON
from hhsim.kernels.mesh.features import (
    EDGE_FIELDS,
    FACE_FIELDS,
    FaceSpheres,
    MeshFeatures,
    face_spheres,
    touchable_vertices,
)
from hhsim.mesh.topology import distinct_rows, merged_vertices

SAME_PLACE = 1e-10
"""Vertices of an open mesh that are closer than this share of its longest extent are one: each copy of an edge would
else have the normals of a border."""
FLAT = 1e-8
"""Sine of the angle between two faces under which their edge is none."""
WITHOUT_AREA = 1e-13
"""A triangle whose height is this share of its longest side, or less, has a normal that is noise."""

BEYOND = 1e-7
"""How far the inside of a face may reach beyond a corner [m]. At the tip of a sliver the sides, each moved by `ON`,
would meet millimetres away; this much makes the distance of a body of millimetres 1e-12 m too short."""


class LeftOut(NamedTuple):
    """How many triangles of a mesh cannot be touched.

    | field | meaning |
    |---|---|
    | without_area | their corners lie on a line |
    | repeated | another one has the same corners |
    """

    without_area: int
    repeated: int


def mesh_features(vertices: FloatArray, faces: IntArray, *, closed: bool) -> tuple[MeshFeatures, LeftOut]:
    """Features of a mesh, and what was left out of it.

    Args:
        vertices: [m], shape (V, 3).
        faces: Indices of the corners, shape (F, 3), counter-clockwise from outside where something is inside.
        closed: Whether the triangles enclose something, so that a point near them is inside or outside.

    Raises:
        MeshError: No triangle has an area.
    """
    vertices = np.asarray(vertices, np.float64)
    place, corners = _along_a_curve(*((vertices, faces) if closed else _welded(vertices, faces)))
    kept = np.sort(distinct_rows(np.sort(corners, axis=1))[0])
    repeated = len(faces) - len(kept)
    corners = corners[kept]
    normal, high = _normals(place, corners)
    corners, normal = corners[high], normal[high]
    without_area = int(len(high) - high.sum())
    if len(corners) == 0:
        raise MeshError(f"none of {len(faces)} triangles has an area; expected a surface mesh")
    # First what needs most room beside it: a million triangles hold a gigabyte in the end.
    face = _faces(place, corners, normal)

    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2)
    low, top = ends.min(axis=1), ends.max(axis=1)
    _, first, edge = np.unique(low * np.int64(len(place)) + top, return_index=True, return_inverse=True)
    edge = edge.reshape(-1)
    start, along = place[low[first]], place[top[first]] - place[low[first]]
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    wing_order = np.argsort(edge, kind="stable")
    wing_face = wing_order // 3
    wing, wing_start = _wings(place, normal, ends, edge, wing_order, len(first))
    flat = _is_flat(wing, wing_start)
    bent = ~flat
    outward = pseudonormals(place, corners) if closed else np.zeros((0, 7, 3))
    if closed:
        bent &= _is_convex(wing, wing_start, normal[wing_face])

    both = np.zeros(len(first), dtype=np.int64)
    both[flat] = wing_face[wing_start[:-1][flat]] + wing_face[wing_start[:-1][flat] + 1]
    face_across = np.where(flat[edge], both[edge] - np.arange(len(ends)) // 3, -1)

    used, owner = np.unique(corners.reshape(-1), return_index=True)
    face_vertex = np.full(len(ends), -1, dtype=np.int64)
    face_vertex[owner] = used

    origin = np.concatenate([low[first], top[first]])
    order = np.argsort(origin, kind="stable")
    spoke = np.ascontiguousarray(np.concatenate([along, -along])[order])
    spoke_start = np.concatenate([[0], np.cumsum(np.bincount(origin, minlength=len(place)))]).astype(np.int64)

    corner = np.ascontiguousarray(place[corners].reshape(-1, 9))
    spheres = face_spheres(corner)
    line = np.ascontiguousarray(np.concatenate([start, along, length[:, None]], axis=1)).reshape(-1, EDGE_FIELDS)
    normal_at = np.zeros((len(place) if closed else 0, 3))
    if closed:
        normal_at[corners] = outward[:, 1:4]
    touchable = np.empty(len(place), dtype=bool)
    touchable_vertices(spoke_start, spoke, normal_at, touchable)
    if not closed:
        border = np.flatnonzero(np.diff(wing_start) == 1)
        inward, own = wing[wing_start[border]], wing_face[wing_start[border]]
        covered = np.zeros(len(border), dtype=bool)
        covered_edges(spheres, face, line[border], inward, own, FLAT, covered)
        bent[border[covered]] = False
        at_border = np.concatenate([low[first][border], top[first][border]])
        touchable &= ~_are_covered(spheres, face, place, corners, at_border)
    face_vertex[face_vertex >= 0] = np.where(touchable[used], used, -1)[np.argsort(owner)]

    face_edge = np.full(len(ends), -1, dtype=np.int64)
    face_edge[first[bent]] = edge[first[bent]]

    features = MeshFeatures(
        spheres=spheres,
        corner=corner,
        face=face,
        face_edge=face_edge.reshape(-1, 3),
        face_vertex=face_vertex.reshape(-1, 3),
        face_across=face_across.reshape(-1, 3),
        edge=line,
        wing_start=wing_start,
        wing=wing,
        wing_face=wing_face,
        vertex=np.ascontiguousarray(place),
        spoke_start=spoke_start,
        spoke=spoke,
        spoke_edge=order % len(first),
        pseudonormal=outward,
    )
    return features, LeftOut(without_area, repeated)


def _are_covered(
    spheres: FaceSpheres, face: FloatArray, place: FloatArray, corners: IntArray, asked: IntArray
) -> BoolArray:
    # Which of the corners asked for lie within the plane of each of their faces.
    covered = np.zeros(len(place), dtype=bool)
    covered[asked] = True
    # Contiguous also where there are many: `nonzero` gives columns, for which the kernel would be compiled once more.
    own, at = (np.ascontiguousarray(values) for values in np.nonzero(covered[corners]))
    corner = corners[own, at]
    around = np.zeros(len(corner), dtype=bool)
    covered_corners(spheres, face, np.ascontiguousarray(place[corner]), own, FLAT, around)
    covered[corner[~around]] = False
    return covered


CELLS = 10
"""Bits of a place on the curve, along each axis."""


def _welded(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    vertices, faces = merged_vertices(vertices, faces)
    welded, corners = merged_vertices(vertices, faces, SAME_PLACE * float(np.ptp(vertices, axis=0).max()))
    # A sliver as narrow as that has its three corners.
    return (vertices, faces) if _pointed(corners) > _pointed(faces) else (welded, corners)


def _pointed(faces: IntArray) -> int:
    # How many have two corners in one.
    return int((faces == np.roll(faces, 1, axis=1)).any(axis=1).sum())


def _along_a_curve(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    # Every place once, and the corners of the faces among them; what is near in space is near in memory, along a
    # Z-curve, since a million triangles are in no cache.
    first, index = distinct_rows(vertices)
    place = vertices[first]
    low, size = place.min(axis=0), float(np.ptp(place, axis=0).max()) or 1.0
    cell = ((place - low) / size * (2**CELLS - 1)).astype(np.int64)
    code = np.zeros(len(place), dtype=np.int64)
    for bit in range(CELLS):
        for k in range(3):
            code |= (cell[:, k] >> bit & 1) << (3 * bit + k)
    order = np.argsort(code, kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    corners = rank[index[faces]]
    return place[order], corners[np.argsort(corners.min(axis=1), kind="stable")]


def _normals(place: FloatArray, corners: IntArray) -> tuple[FloatArray, BoolArray]:
    # Unit normals by the two shorter sides, and which triangles have one.
    a, b, c = (place[corners[:, k]] for k in range(3))
    sides = np.stack([b - a, c - b, a - c], axis=1)
    squares = np.einsum("fkm,fkm->fk", sides, sides)
    longest = np.argmax(squares, axis=1)
    rows = np.arange(len(corners))
    cross = np.cross(sides[rows, (longest + 1) % 3], sides[rows, (longest + 2) % 3])
    double_area = np.linalg.norm(cross, axis=1)
    high = double_area > WITHOUT_AREA * squares[rows, longest]
    return cross / np.where(high, double_area, 1.0)[:, None], high


def _faces(place: FloatArray, corners: IntArray, normal: FloatArray) -> FloatArray:
    a = place[corners[:, 0]]
    face = np.empty((len(corners), FACE_FIELDS))
    face[:, :3] = normal
    face[:, 3] = np.einsum("ij,ij->i", normal, a)
    slack = np.minimum(ON, BEYOND * _least_half_sine(place[corners]))
    for k in range(3):
        p, q = place[corners[:, k]], place[corners[:, (k + 1) % 3]]
        inward = np.cross(normal, q - p)
        inward /= np.linalg.norm(inward, axis=1)[:, None]
        face[:, 4 + 4 * k : 7 + 4 * k] = inward
        face[:, 7 + 4 * k] = np.einsum("ij,ij->i", inward, p) - slack
    return face


def _least_half_sine(triangle: FloatArray) -> FloatArray:
    # Of half the sharpest corner of each triangle, shape (F, 3, 3); corner by corner, since there may be a million.
    least = np.full(len(triangle), np.inf)
    for k in range(3):
        out, back = triangle[:, (k + 1) % 3] - triangle[:, k], triangle[:, k - 1] - triangle[:, k]
        angle = np.arctan2(np.linalg.norm(np.cross(out, back), axis=1), np.einsum("fm,fm->f", out, back))
        np.minimum(least, angle, out=least)
    return np.asarray(np.sin(0.5 * least))


def _wings(
    place: FloatArray, normal: FloatArray, ends: IntArray, edge: IntArray, order: IntArray, edges: int
) -> tuple[FloatArray, IntArray]:
    # Of every side of every face the unit vector in the face, across the side and inward; sorted by edge.
    inward = np.cross(np.repeat(normal, 3, axis=0), place[ends[:, 1]] - place[ends[:, 0]])
    inward /= np.linalg.norm(inward, axis=1)[:, None]
    start = np.concatenate([[0], np.cumsum(np.bincount(edge, minlength=edges))]).astype(np.int64)
    return np.ascontiguousarray(inward[order]), start


def _is_flat(wing: FloatArray, start: IntArray) -> BoolArray:
    two = np.diff(start) == 2
    flat = np.zeros(len(two), dtype=bool)
    first = start[:-1][two]
    flat[two] = np.linalg.norm(wing[first] + wing[first + 1], axis=1) < FLAT
    return flat


def _is_convex(wing: FloatArray, start: IntArray, normal: FloatArray) -> BoolArray:
    # Seen from outside; what is not an edge of two faces counts as convex. The normals are of the wings' faces.
    convex = np.ones(len(start) - 1, dtype=bool)
    two = np.diff(start) == 2
    first = start[:-1][two]
    convex[two] = np.einsum("ij,ij->i", wing[first], normal[first + 1]) < 0.0
    return convex
