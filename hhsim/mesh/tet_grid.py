"""A box of tetrahedra that is refined locally, and the closed surface between inside and outside."""

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.kernels.mesh.tet_grid import MOST_COORDINATE, Tets, fill_table, halve_tets, locate

HALVINGS = 11
"""Largest number of halvings of a cube's edge."""

_CUBE = 1 << HALVINGS


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
    def leaves(self) -> IntArray:
        """Tetrahedra that are not halved."""
        return np.flatnonzero(self._tets.child[: self._tets.used[0]] < 0)

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
        leaves = self.leaves
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


_CASES = {
    1: (((0, 1), (0, 2), (0, 3)),),
    2: (((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2))),
    3: (((0, 3), (1, 3), (2, 3)),),
}
"""Triangles of a positive tetrahedron with its first vertices inside, by the edges that their corners lie on."""
