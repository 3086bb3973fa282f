"""Contact features of a mesh: its faces, edges and vertices.

Any triangles will do: open, loose, three at an edge, on top of each other. Vertices at the same place are merged, and
so are those that rounding has separated; of several triangles on the same corners one is kept. A triangle without
area is touched as a line or point. The proved boundary of a solid is touched from outside alone: concave edges, and
vertices that only an inside could touch, are then no features. Any other mesh is touched from both sides.
"""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.kernels.mesh import features as kernel
from hhsim.kernels.mesh.bvh import pseudonormals, winding_numbers
from hhsim.kernels.mesh.covered_borders import covered_corners, covered_edges, touches_itself
from hhsim.kernels.mesh.feature_distance import ON
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.kernels.sphere_tree import TreeArrays
from hhsim.mesh.topology import directed_edges, distinct_rows, face_areas, merged_vertices, part_labels
from hhsim.reproducible import arc_tangent, dot, norm, sine_and_cosine

SAME_PLACE = 1e-10
"""Vertices of an open mesh closer than this share of its longest extent are merged: each copy of an edge would
otherwise have the normals of a border."""
FLAT = 1e-8
"""Sine of the angle between two faces below which their edge is no feature."""
WITHOUT_AREA = 1e-10
"""A triangle whose height is this share of its longest side, or less, has a normal that is noise."""
LINE = 1e-13
"""Same share for a triangle whose corners lie on a line but for rounding: a mesh of nothing else is no surface."""
WIDTH = 1e-9
"""Width [m] of the strip along its longest side that stands for a triangle without area."""
HIGHEST = 0.1
"""Height above a face [m] from which nothing is touched: the radius of a body and the reach of its list together are
less. Up to this height the gap between two almost coplanar faces is narrower than what each reaches beyond its
sides."""

BEYOND = 1e-7
"""Limit of the reach of a face beyond a corner [m]. At the tip of a sliver the sides, each moved by `ON`, would meet
millimetres away; this much makes the distance of a body of millimetres 1e-12 m too short."""
WINDING_WORK = 3.0e7
"""Largest number of pairs of a part and a triangle for winding numbers, about a third of a second. A mesh of more parts
is touched from both sides, which is right for any mesh and slower."""
BEHIND = 0.25
"""Least mean of the winding numbers on both sides of a triangle with a solid behind it: it is 1/2 there, and -1/2 for
one that is wound inside out."""


def mesh_features(vertices: FloatArray, faces: IntArray, *, closed: bool) -> tuple[MeshFeatures, int]:
    """Compute the features of a mesh, and the number of triangles dropped as copies of another one on the same corners.

    Faces are counter-clockwise from outside where something is inside; `closed` says that they enclose something, so
    that a point near them is inside or outside. Raises MeshError where no triangle has an area.
    """
    vertices = np.asarray(vertices, np.float64)
    place, corners = _along_a_curve(*((vertices, faces) if closed else _welded(vertices, faces)))
    kept, kind = distinct_rows(np.sort(corners, axis=1))
    multiplicity = _net_windings(corners, kept, kind)
    order = np.argsort(kept, kind="stable")
    repeated, corners, multiplicity = len(corners) - len(kept), corners[kept[order]], multiplicity[order]
    corner = np.ascontiguousarray(place[corners].reshape(-1, 9))
    normal, height = _normals(corner.reshape(-1, 3, 3))
    high = height > WITHOUT_AREA
    if not (height > LINE).any():
        raise MeshError(f"none of {len(faces)} triangles has an area; expected a surface mesh")
    shape = corner.reshape(-1, 3, 3).copy()
    shape[~high] = _strips(shape[~high])
    normal[~high] = _normals(shape[~high])[0]
    # First what needs most room beside it: a million triangles hold a gigabyte in the end.
    face, slack = _faces(shape, normal)
    tree = kernel.face_tree(corner)

    side, ends, edge, first, edge_ends, line = _edges(place, corners)
    # What has no area has no direction across its sides.
    wide = high[side // 3]
    wing_order = np.flatnonzero(wide)[np.argsort(edge[wide], kind="stable")]
    wing_face = side[wing_order] // 3
    # The unit vector in the face, across the side and inward; and where the sides of each edge begin.
    wing = np.ascontiguousarray(np.cross(normal[wing_face], place[ends[wing_order, 1]] - place[ends[wing_order, 0]]))
    wing /= np.linalg.norm(wing, axis=1)[:, None]
    wing_start = _starts(edge[wing_order], len(first))
    two = np.diff(wing_start) == 2
    one_sided = (
        closed
        and repeated == 0
        and bool(high.all() and two.all())
        and not touches_itself(tree, corner, face, corners, line, edge_ends)
        and _has_solid_behind(place, corners)
    )
    # Flat where the gap between the two faces, as high as anything is felt, is no wider than what they reach beyond it.
    left = wing_start[:-1][two]
    gap = np.linalg.norm(wing[left] + wing[left + 1], axis=1)
    reach = np.minimum(slack[wing_face[left]], slack[wing_face[left + 1]])
    flat = np.zeros(len(first), dtype=bool)
    flat[two] = (gap < FLAT) & (HIGHEST * gap <= reach)
    bent = ~flat
    outward = pseudonormals(place, corners) if one_sided else np.zeros((0, 7, 3))
    if one_sided:
        # Convex as seen from outside, as is what is not an edge of two faces.
        bent[two] &= dot(wing[left], normal[wing_face[left + 1]]) < 0.0

    both = np.zeros(len(first), dtype=np.int64)
    both[two] = wing_face[left] + wing_face[left + 1]
    face_across = np.full(3 * len(corners), -1, dtype=np.int64)
    face_across[side] = np.where(flat[edge], both[edge] - side // 3, -1)

    used, owner = np.unique(corners.reshape(-1), return_index=True)
    face_vertex = np.full(3 * len(corners), -1, dtype=np.int64)

    origin, along = np.concatenate([edge_ends[:, 0], edge_ends[:, 1]]), line[:, 3:6]
    order = np.argsort(origin, kind="stable")
    spoke = np.ascontiguousarray(np.concatenate([along, -along])[order])
    spoke_start = _starts(origin, len(place))

    normal_at = np.zeros((len(place) if one_sided else 0, 3))
    if one_sided:
        normal_at[corners] = outward[:, 1:4]
    touchable = np.empty(len(place), dtype=bool)
    kernel.touchable_vertices(spoke_start, spoke, normal_at, touchable)
    if not one_sided:
        border = np.flatnonzero(np.diff(wing_start) == 1)
        inward, own = wing[wing_start[border]], wing_face[wing_start[border]]
        covered = np.zeros(len(border), dtype=bool)
        covered_edges(tree, face, line[border], inward, own, FLAT, covered)
        bent[border[covered]] = False
        touchable &= ~_are_covered(tree, face, place, corners, edge_ends[border].ravel())
    face_vertex[owner] = np.where(touchable[used], used, -1)

    face_edge = np.full(3 * len(corners), -1, dtype=np.int64)
    face_edge[side[first[bent]]] = edge[first[bent]]

    features = MeshFeatures(
        tree=tree,
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
        multiplicity=multiplicity if closed else np.zeros(0, dtype=np.int64),
        pseudonormal=outward,
    )
    return features, repeated


def _net_windings(corners: IntArray, kept: IntArray, kind: IntArray) -> IntArray:
    # Of each kind of triangle how often it is there wound as the kept one, less how often the other way.
    a, b, c = corners.T
    turn = np.sign(b - a) * np.sign(c - b) * np.sign(a - c)
    net = np.zeros(len(kept), dtype=np.int64)
    np.add.at(net, kind, turn)
    return np.asarray(net * turn[kept])


def _strips(triangle: FloatArray) -> FloatArray:
    # Narrow triangles along the longest sides of those without area, shape (N, 3, 3).
    rows = np.arange(len(triangle))
    sides = np.roll(triangle, -1, axis=1) - triangle
    length = np.linalg.norm(sides, axis=2)
    first = np.argmax(length, axis=1)
    longest = length[rows, first]
    start, along = triangle[rows, first], sides[rows, first]
    along[longest == 0.0] = (1.0, 0.0, 0.0)
    along /= np.where(longest == 0.0, 1.0, longest)[:, None]
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=1)])
    across /= np.linalg.norm(across, axis=1)[:, None]
    end = start + np.where(longest == 0.0, WIDTH, longest)[:, None] * along
    return np.stack([start, end, start + WIDTH * across], axis=1)


def _are_covered(
    tree: TreeArrays, face: FloatArray, place: FloatArray, corners: IntArray, marked: IntArray
) -> BoolArray:
    # Which of the corners marked lie within the plane of each of their faces.
    covered = np.zeros(len(place), dtype=bool)
    covered[marked] = True
    # Contiguous also where there are many: `nonzero` gives columns, for which the kernel would be compiled once more.
    own, at = (np.ascontiguousarray(values) for values in np.nonzero(covered[corners]))
    corner = corners[own, at]
    around = np.zeros(len(corner), dtype=bool)
    covered_corners(tree, face, np.ascontiguousarray(place[corner]), own, FLAT, around)
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
    corners = np.argsort(order)[index[faces]]
    return place[order], corners[np.argsort(corners.min(axis=1), kind="stable")]


def _normals(triangle: FloatArray) -> tuple[FloatArray, FloatArray]:
    # Unit normals by the two shorter sides, and heights as shares of the longest sides.
    sides = np.roll(triangle, -1, axis=1) - triangle
    squares = dot(sides, sides)
    longest = np.argmax(squares, axis=1)
    rows = np.arange(len(triangle))
    cross = np.cross(sides[rows, (longest + 1) % 3], sides[rows, (longest + 2) % 3])
    double_area = np.linalg.norm(cross, axis=1)
    height = double_area / np.where(squares[rows, longest] > 0.0, squares[rows, longest], 1.0)
    return cross / np.where(double_area > 0.0, double_area, 1.0)[:, None], height


def _faces(triangle: FloatArray, normal: FloatArray) -> tuple[FloatArray, FloatArray]:
    # The fields of each face, and how far it reaches beyond its sides [m].
    face = np.empty((len(triangle), kernel.FACE_FIELDS))
    face[:, :3] = normal
    face[:, 3] = dot(normal, triangle[:, 0])
    sharpest = np.full(len(triangle), np.inf)
    # Corner by corner, since there may be a million triangles.
    for k in range(3):
        out, back = triangle[:, (k + 1) % 3] - triangle[:, k], triangle[:, k - 1] - triangle[:, k]
        np.minimum(sharpest, arc_tangent(norm(np.cross(out, back)), dot(out, back)), out=sharpest)
    slack = np.minimum(ON, BEYOND * sine_and_cosine(0.5 * sharpest)[0])
    for k in range(3):
        p, q = triangle[:, k], triangle[:, (k + 1) % 3]
        inward = np.cross(normal, q - p)
        inward /= np.linalg.norm(inward, axis=1)[:, None]
        face[:, 4 + 4 * k : 7 + 4 * k] = inward
        face[:, 7 + 4 * k] = dot(inward, p) - slack
    return face, slack


def _edges(place: FloatArray, corners: IntArray) -> tuple[IntArray, IntArray, IntArray, IntArray, IntArray, FloatArray]:
    # Of the S sides of triangles that have two ends: number, 3 · triangle + corner, (S,), corners (S, 2), edge (S,). Of
    # the E edges: the first side among the S (E,), corners, the lower one first (E, 2), fields (E, EDGE_FIELDS).
    ends = directed_edges(corners)
    side = np.flatnonzero(ends[:, 0] != ends[:, 1])
    ends = ends[side]
    low, top = ends.min(axis=1), ends.max(axis=1)
    _, first, edge = np.unique(low * np.int64(len(place)) + top, return_index=True, return_inverse=True)
    edge_ends = np.ascontiguousarray(np.stack([low[first], top[first]], axis=1))
    start, along = place[edge_ends[:, 0]], place[edge_ends[:, 1]] - place[edge_ends[:, 0]]
    length = np.linalg.norm(along, axis=1)[:, None]
    line = np.ascontiguousarray(np.concatenate([start, along / length, length], axis=1)).reshape(-1, kernel.EDGE_FIELDS)
    return side, ends, edge.reshape(-1), first, edge_ends, line


def _starts(group: IntArray, groups: int) -> IntArray:
    # Where the members of each group begin, in the order of the groups, and the end.
    return np.concatenate([[0], np.cumsum(np.bincount(group, minlength=groups))]).astype(np.int64)


def _has_solid_behind(place: FloatArray, corners: IntArray) -> bool:
    """Return True if the winding number is at least 1 behind every triangle.

    The triangles are closed, two at each side, and touch only there: the number is the same behind all of a part.
    """
    part = part_labels(corners)
    parts = int(part.max()) + 1
    if parts * len(corners) > WINDING_WORK:
        return False
    # The largest triangle of each part, at whose middle all others are far away.
    order = np.lexsort((-face_areas(place, corners), part))
    largest = order[np.searchsorted(part[order], np.arange(parts))]
    triangles = np.ascontiguousarray(place[corners])
    for i in largest.tolist():
        middle = triangles[i].mean(axis=0)[None]
        whole, own = np.empty(1), np.empty(1)
        winding_numbers(triangles, middle, whole)
        # On the triangle itself its own share is 1/2 or -1/2, by rounding; without it the mean of both sides is left.
        winding_numbers(triangles[i : i + 1], middle, own)
        if not float(whole[0] - own[0]) > BEHIND:
            return False
    return True
