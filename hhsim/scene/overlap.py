"""Depth of meshes in each other: the largest lower bound found of the shortest shift that would take them apart.

Two triangles that cross come apart by no less than the least of the shifts along eleven directions. A point at depths a
and b in two solids leaves one of them after a + b at the earliest, whether their surfaces cross or coincide.
"""

from collections.abc import Iterator

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.kernels.mesh.bvh import build_mesh_bvh, face_normals, mesh_signed_distance
from hhsim.mesh.mesh import Mesh
from hhsim.trees.contact_surface import encloses

SPACING, MOST_PIECES = 4e-3, 64
"""Distance [m] of the points of an edge that are looked for in another mesh, and most pieces of it."""
HALVINGS, MOST_FACES = 12, 200
"""Points behind a face are half, a quarter, ... of the mesh's length away from it; most faces that have some."""
TOGETHER = 1 << 16
"""Most pairs of triangles whose boxes are compared at once."""
PARALLEL = 1e-12
"""Sine of the angle of two edges below which they have no direction across."""


class Solid:
    """A mesh in the world [m], and points of its surface and, if it encloses a space, of its inside, with depths."""

    def __init__(self, mesh: Mesh) -> None:
        self.triangles, self.bounds = mesh.triangles, mesh.bounds
        self.shell = build_mesh_bvh(mesh.vertices, mesh.faces) if encloses(mesh) else None
        surface, inner, depth = _surface_points(mesh), np.empty((0, 3)), np.empty(0)
        if self.shell is not None:
            some = np.unique(np.linspace(0, len(mesh.faces) - 1, MOST_FACES).astype(int))
            behind = float(mesh.extent.max()) * 0.5 ** np.arange(1, HALVINGS + 1)[:, None, None]
            inner = mesh.triangles[some].mean(axis=1) - behind * face_normals(mesh.vertices, mesh.faces[some])
            inner = np.concatenate([inner.reshape(-1, 3), mesh.bounds.mean(axis=0)[None]])
            depth = -mesh_signed_distance(self.shell, inner)
        self.points = np.concatenate([surface, inner[depth > 0.0]])
        self.depth = np.concatenate([np.zeros(len(surface)), depth[depth > 0.0]])

    def depth_of(self, other: "Solid") -> float:
        """Compute how deep another mesh is in this one [m] by its points; 0 outside, or where this encloses nothing."""
        low, high = self.bounds
        at = np.flatnonzero(((other.points > low) & (other.points < high)).all(axis=1))
        if self.shell is None or not len(at):
            return 0.0
        away = mesh_signed_distance(self.shell, other.points[at])
        return float(np.where(away < 0.0, other.depth[at] - away, 0.0).max())


def overlap(one: Solid, two: Solid) -> float:
    """Compute how deep two meshes are in each other [m]; 0 apart."""
    deepest = max(one.depth_of(two), two.depth_of(one))
    for i, j in _near(one.triangles, two.triangles):
        deepest = max(deepest, float(_crossing(one.triangles[i], two.triangles[j]).max()))
    return deepest


def _near(one: FloatArray, two: FloatArray) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the pairs of triangles, (N, 3, 3) and (M, 3, 3), whose boxes meet."""
    boxes = [(corners.min(axis=1), corners.max(axis=1)) for corners in (one, two)]
    left = [(np.arange(len(one)), np.arange(len(two)))]
    while left:
        of = list(left.pop())
        for here in (0, 1):
            (low, high), (other_low, other_high) = boxes[here], boxes[1 - here]
            own, other = of[here], of[1 - here]
            if len(other):
                met = (low[own] <= other_high[other].max(axis=0)) & (high[own] >= other_low[other].min(axis=0))
                of[here] = own[met.all(axis=1)]
        a, b = of
        if len(a) * len(b) <= TOGETHER:
            (low, high), (other_low, other_high) = boxes
            meets = (low[a][:, None] <= other_high[b]) & (high[a][:, None] >= other_low[b])
            i, j = np.nonzero(meets.all(axis=2))
            if len(i):
                yield a[i], b[j]
            continue
        larger = int(len(b) > len(a))
        middle = boxes[larger][0][of[larger]] + boxes[larger][1][of[larger]]
        order = np.argsort(middle[:, np.ptp(middle, axis=0).argmax()], kind="stable")
        halves = np.array_split(of[larger][order], 2)
        left += [(half, b) if larger == 0 else (a, half) for half in halves]


def _crossing(one: FloatArray, two: FloatArray) -> FloatArray:
    """Compute the least shift that takes each triangle out of another one [m], (K, 3, 3) each; 0 of those apart."""
    edges = [np.roll(corners, -1, axis=1) - corners for corners in (one, two)]
    length = [np.linalg.norm(each, axis=2) for each in edges]
    axes = [(each[:, 0], each[:, 1], size[:, 0] * size[:, 1]) for each, size in zip(edges, length)]
    axes += [(edges[0][:, i], edges[1][:, j], length[0][:, i] * length[1][:, j]) for i in range(3) for j in range(3)]
    least = np.full(len(one), np.inf)
    for first, second, most in axes:
        axis = np.cross(first, second)
        size = np.linalg.norm(axis, axis=1)
        along = axis / np.where(size > PARALLEL * most, size, np.inf)[:, None]
        here, there = ((corners @ along[:, :, None])[:, :, 0] for corners in (one, two))
        shift = np.minimum(here.max(axis=1) - there.min(axis=1), there.max(axis=1) - here.min(axis=1))
        least = np.minimum(least, np.where(size > PARALLEL * most, shift, np.inf))
    return np.where(np.isfinite(least), least.clip(min=0.0), 0.0)


def _surface_points(mesh: Mesh) -> FloatArray:
    """Return points on the triangles, at most `SPACING` apart where an edge has no more than `MOST_PIECES`, (n, 3)."""
    found = []
    for a, b, c in mesh.triangles:
        longest = np.sqrt(max(((b - a) ** 2).sum(), ((c - a) ** 2).sum(), ((c - b) ** 2).sum()))
        pieces = int(np.clip(np.ceil(longest / SPACING), 1, MOST_PIECES)) if len(mesh.faces) < 1000 else 1
        i, j = np.mgrid[: pieces + 1, : pieces + 1]
        u, v = i[i + j <= pieces] / pieces, j[i + j <= pieces] / pieces
        found.append(a + u[:, None] * (b - a) + v[:, None] * (c - a))
    return np.concatenate(found)
