"""Closed mesh of a solid that is known only by a test of points: adaptive, to a tolerance that is then measured."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.kernels.mesh.bvh import MeshBvh, build_mesh_bvh, fast_winding_numbers, mesh_signed_distance
from hhsim.kernels.mesh.inside_field import MOST_COORDINATE, Tets, fill_table, halve_tets, leave_inside, locate, near
from hhsim.mesh.topology import is_closed, manifold_of, part_labels, triangles_of, used_vertices

HALVINGS = 11
"""Largest number of halvings of a cube's edge."""

_CUBE = 1 << HALVINGS

_CASES = {
    1: (((0, 1), (0, 2), (0, 3)),),
    2: (((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2))),
    3: (((0, 3), (1, 3), (2, 3)),),
}
"""Triangles of a positive tetrahedron with its first vertices inside, by the edges that their corners lie on."""

COARSE = 16
"""Cubes of the coarse grid along the longest extent."""
FIRST = 3
"""Number of first halvings of the tetrahedra at the known surface."""
MOST_TETS = 3_000_000
MOST_TRIANGLES = 600_000
ENOUGH = 100_000
"""Number of triangles from which on only what is missed is refined."""
MARGIN = 0.07
"""Margin of the grid around the solid, as a share of the longest extent."""
_SIMPLER = (0.5, 0.1)
_NEAREST = 1e-3
"""A corner of the surface keeps this share of its edge away from the ends."""


class TetGrid:
    """Tetrahedra over a box with a lower corner (3,) [m], of so many cubes (3,) with an edge [m]."""

    def __init__(self, low: FloatArray, high: FloatArray, edge: float) -> None:
        """Fill the box from `low` to `high` [m] with cubes of an edge [m], each of six tetrahedra."""
        self.low, self.edge = np.asarray(low, np.float64), float(edge)
        self.cubes = np.maximum(1, np.ceil((np.asarray(high) - self.low) / edge)).astype(np.int64)
        if int(self.cubes.max()) * _CUBE > MOST_COORDINATE:
            raise ValueError(f"{self.cubes} cubes are too many")
        size = self.cubes + 1
        corner = np.stack(np.meshgrid(*(np.arange(n) for n in size), indexing="ij"), axis=3).reshape(-1, 3)
        number = np.arange(len(corner)).reshape(size)
        tets = []
        for a in range(3):
            for b in ((a + 1) % 3, (a + 2) % 3):
                step = np.zeros((4, 3), np.int64)
                step[1:, a] = 1
                step[2:, b] = 1
                step[3:] = 1
                tets.append(
                    np.stack([number[tuple(slice(s, s + n) for s, n in zip(q, self.cubes))] for q in step], axis=3)
                )
        tet = np.stack(tets, axis=3).reshape(-1, 4)
        none = np.zeros(len(tet), np.int64)
        self._tets = Tets(
            tet=tet,
            tag=none + 3,
            age=none,
            child=none - 1,
            vertex=np.ascontiguousarray(corner * _CUBE),
            table=np.empty(0, np.int64),
            cubes=self.cubes,
            used=np.array([len(tet), len(corner), len(corner)]),
        )
        self._reserve()

    def _reserve(self) -> None:
        """Make the arrays at least twice as long as what is in use."""
        tets, vertices, _ = self._tets.used

        def longer(array: IntArray, used: int) -> IntArray:
            if len(array) >= 2 * used:
                return array
            result = np.empty((4 * used, *array.shape[1:]), np.int64)
            result[:used] = array[:used]
            return result

        vertex = longer(self._tets.vertex, vertices)
        table = self._tets.table
        if len(table) < 2 * len(vertex):
            table = np.empty(1 << int(2 * len(vertex) - 1).bit_length(), np.int64)
            fill_table(vertex, vertices, table)
        tet, tag, age, child = (longer(array, tets) for array in self._tets[:4])
        self._tets = self._tets._replace(tet=tet, tag=tag, age=age, child=child, vertex=vertex, table=table)

    @property
    def points(self) -> FloatArray:
        """Places of the vertices [m], shape (V, 3)."""
        return np.ascontiguousarray(self.low + self._tets.vertex[: self._tets.used[1]] * (self.edge / _CUBE))

    @property
    def tets(self) -> IntArray:
        """Vertices of every tetrahedron, halved ones too, shape (T, 4)."""
        return self._tets.tet[: self._tets.used[0]]

    @property
    def ages(self) -> IntArray:
        """Number of halvings of each; three halve the edges, shape (T,)."""
        return self._tets.age[: self._tets.used[0]]

    def refine(self, chosen: IntArray, times: int = 3) -> None:
        """Halve some tetrahedra, as many `times` each, and others as far as that needs."""
        wanted = np.zeros(len(self.tets), np.int64)
        wanted[chosen] = np.minimum(self.ages[chosen] + times, 3 * HALVINGS)
        done = False
        while not done:
            padded = np.zeros(len(self._tets.tet), np.int64)
            padded[: len(wanted)] = wanted
            done = halve_tets(self._tets, _CUBE, padded)
            wanted = padded
            self._reserve()

    def locate(self, points: FloatArray) -> IntArray:
        """Return the tetrahedron of each point [m], shape (n, 3); −1 outside of the box."""
        result = np.empty(len(points), np.int64)
        locate(self._tets, _CUBE, np.ascontiguousarray((points - self.low) * (_CUBE / self.edge)), result)
        return result

    def on_border(self) -> BoolArray:
        """Return True for each vertex on the border of the box, shape (V,)."""
        vertex = self._tets.vertex[: self._tets.used[1]]
        return np.asarray(((vertex == 0) | (vertex == self.cubes * _CUBE)).any(axis=1))

    def surface(self, inside: BoolArray) -> tuple[IntArray, IntArray, IntArray]:
        """Extract the surface between vertices inside, True in (V,), and outside, by marching tetrahedra.

        It is closed, manifold, and wound outward: the edges that it cuts, as (inside, outside), shape (n, 2), its
        triangles, as indices of those edges, shape (m, 3), and the tetrahedron of each triangle, shape (m,).
        """
        leaves = np.flatnonzero(self._tets.child[: self._tets.used[0]] < 0)
        tet = self._tets.tet[leaves]
        number = inside[tet].sum(axis=1)
        cut = (number > 0) & (number < 4)
        leaves, tet, number = leaves[cut], tet[cut], number[cut]
        # Those inside first; the order then turns the tetrahedron over or not.
        order = np.argsort(~inside[tet], axis=1, kind="stable")
        tet = np.take_along_axis(tet, order, axis=1)
        corner = self._tets.vertex[tet]
        arm = corner[:, 1:] - corner[:, :1]
        turned = np.einsum("ij,ij->i", np.cross(arm[:, 0], arm[:, 1]), arm[:, 2]) < 0
        parts = []
        for count, triangles in _CASES.items():
            for triangle in triangles:
                rows = np.flatnonzero(number == count)
                ends = tet[rows][:, np.array(triangle)]
                ends[turned[rows]] = ends[turned[rows]][:, ::-1]
                parts.append((ends, leaves[rows]))
        ends = np.concatenate([part[0] for part in parts]).reshape(-1, 2)
        owner = np.concatenate([part[1] for part in parts])
        vertices = self._tets.used[1]
        key, index = np.unique(ends[:, 0] * vertices + ends[:, 1], return_inverse=True)
        edges = np.stack([key // vertices, key % vertices], axis=1)
        return edges, index.reshape(-1, 3).astype(np.int64), owner


class _Crossings:
    """Points at which the edges of a grid leave the solid; each is searched for once."""

    def __init__(self, bvh: MeshBvh) -> None:
        self.bvh = bvh
        self.key, self.point = np.empty(0, np.int64), np.empty((0, 3))

    def of(self, edges: IntArray, points: FloatArray) -> FloatArray:
        """Places [m] for edges (vertex inside, vertex outside), shape (n, 2)."""
        key = (edges[:, 0] << np.int64(32)) | edges[:, 1]
        at = np.minimum(np.searchsorted(self.key, key), max(len(self.key) - 1, 0))
        known = self.key[at] == key if len(self.key) else np.zeros(len(key), np.bool_)
        place = np.empty((len(key), 3))
        place[known] = self.point[at[known]]
        start, end = points[edges[~known, 0]], points[edges[~known, 1]]
        share = np.empty(len(start))
        leave_inside(self.bvh, start, end, share)
        place[~known] = start + np.clip(share, _NEAREST, 1.0 - _NEAREST)[:, None] * (end - start)
        order = np.argsort(key)
        self.key, self.point = key[order], place[order]
        return place


def solid_mesh(
    bvh: MeshBvh, border: FloatArray, low: FloatArray, high: FloatArray, tolerance: float
) -> tuple[FloatArray, IntArray]:
    """Compute a closed manifold mesh of a solid, wound outward: vertices (V, 3), faces (F, 3); empty without inside.

    Tetrahedra are halved where the mesh is off by more than the tolerance: where a triangle's middle has none of the
    solid's triangles that near and, moved by the tolerance outward and inward, is not outside and inside; or where a
    point of the true border, which are known in `border`, shape (n, 3), is farther away. The mesh may get too large
    first, so its error has to be measured. `bvh` is built by winding; `low` and `high` are corners of a box around it.
    """
    extent = float((high - low).max())
    # Off the round numbers that drawn meshes are made of.
    off = MARGIN * extent * np.array([1.0, 1.0137, 0.9871])
    grid = TetGrid(low - off, high + off, extent / COARSE)
    grid.refine(np.unique(grid.locate(border)), FIRST)
    crossings = _Crossings(bvh)
    within = np.empty(0, np.bool_)
    good = np.empty(0, np.bool_)
    waiting = border
    oldest = min(3 * HALVINGS, 3 * int(np.ceil(np.log2(extent / COARSE / tolerance))))
    while True:
        points = grid.points
        within = np.concatenate([within, fast_winding_numbers(bvh, points[len(within) :]) > 0.5])
        within[grid.on_border()] = False
        edges, faces, owner = grid.surface(within)
        if len(faces) == 0:
            return np.empty((0, 3)), faces
        vertices = crossings.of(edges, points)
        good = np.concatenate([good, np.zeros(len(grid.tets) - len(good), np.bool_)])
        fresh = np.flatnonzero(~good[owner])
        a, b, c = vertices[faces[fresh]].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        length = np.linalg.norm(normal, axis=1)
        step = tolerance * normal / np.where(length > 0.0, length, 1.0)[:, None]
        middle = (a + b + c) / 3.0
        wrong = np.zeros(len(fresh), np.bool_)
        near(bvh, middle, tolerance, wrong)
        wrong = ~wrong
        before, behind = (fast_winding_numbers(bvh, (middle + side)[wrong]) > 0.5 for side in (step, -step))
        wrong[wrong] = before | ~behind
        good[owner[fresh]] = True
        good[owner[fresh[wrong]]] = False
        far = np.abs(mesh_signed_distance(build_mesh_bvh(vertices, faces, signed=False), waiting)) > tolerance
        waiting = waiting[far]
        missed = grid.locate(waiting)
        # Near the end, what is missed altogether comes first.
        chosen = np.unique(np.concatenate([owner[fresh[wrong]], missed]) if len(faces) < ENOUGH else missed)
        chosen = chosen[(chosen >= 0) & (grid.ages[chosen] < oldest)]
        if len(chosen) == 0 or len(faces) > MOST_TRIANGLES or len(grid.tets) > MOST_TETS:
            return _without_specks(vertices, faces, 4.0 * tolerance)
        grid.refine(chosen)


def _without_specks(vertices: FloatArray, faces: IntArray, size: float) -> tuple[FloatArray, IntArray]:
    label = part_labels(faces)
    corner = vertices[faces].reshape(-1, 3)
    low, high = np.full((int(label.max()) + 1, 3), np.inf), np.full((int(label.max()) + 1, 3), -np.inf)
    np.minimum.at(low, np.repeat(label, 3), corner)
    np.maximum.at(high, np.repeat(label, 3), corner)
    return used_vertices(vertices, faces[((high - low).max(axis=1) > size)[label]])


def border_distances(vertices: FloatArray, faces: IntArray, border: FloatArray) -> tuple[float, float]:
    """Return the largest distance of points, shape (n, 3), outside of a closed mesh, and inside of it."""
    distance = mesh_signed_distance(build_mesh_bvh(vertices, faces), border)
    return float(distance.max(initial=0.0)), float(-distance.min(initial=0.0))


def simplified(
    vertices: FloatArray, faces: IntArray, border: FloatArray, tolerance: float
) -> tuple[FloatArray, IntArray]:
    """Simplify the mesh where that takes it no farther from points of the border, shape (n, 3)."""
    before = max(border_distances(vertices, faces, border))
    whole = manifold_of(vertices, faces)
    if whole is None:
        return vertices, faces
    for share in _SIMPLER:
        points, triangles = triangles_of(whole.simplify(share * tolerance))
        if len(triangles) == 0 or not is_closed(triangles):
            continue
        if max(border_distances(points, triangles, border)) <= max(before, tolerance) + share * tolerance:
            return points, triangles
    return vertices, faces
