"""Oracles for round cones, boxes and points beside triangles; all but `least_of_features` without code of the kernels.

The distance of a round cone is searched along its axis, where it is convex: sampled densely, then narrowed by golden
sections down to rounding.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numba
import numpy as np
import trimesh

from hhsim.arrays import FloatArray
from hhsim.kernels.mesh.feature_distance import edge_distance, face_distance, vertex_distance
from hhsim.kernels.mesh.features import MeshFeatures
from hhsim.kernels.round_cone import RoundCone, cone_slope
from hhsim.mesh.mesh import Mesh

NEEDLE = 1e-9
"""Height of a triangle, as a share of its longest side, up to which it is no more than its sides: the direction of its
normal is rounding."""
SAMPLES = 65
SECTIONS = 80
"""Golden sections after the samples: 2 / 64 of the axis shrinks by 1e-17."""
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def mesh_of(shape: trimesh.Trimesh, name: str = "shape") -> Mesh:
    """A shape of trimesh as a mesh of ours."""
    return Mesh(np.asarray(shape.vertices), np.asarray(shape.faces), name=name)


class Cones(NamedTuple):
    """Round cones: ends of the axes [m] (n, 3), radii there [m] (n,), the first no smaller than the second."""

    a: FloatArray
    b: FloatArray
    radius_a: FloatArray
    radius_b: FloatArray

    def kernel(self, i: int) -> RoundCone:
        """One of them as the kernels take it; a sphere alone where that holds the other."""
        axis = self.b[i] - self.a[i]
        length = float(np.linalg.norm(axis))
        radius_a, radius_b = float(self.radius_a[i]), float(self.radius_b[i])
        tan_slope, inverse = cone_slope(length, radius_a, radius_b)
        unit = axis / length if length > 0.0 else np.zeros(3)
        x, y, z = self.a[i].tolist()
        ux, uy, uz = unit.tolist()
        if inverse == 0.0:
            return RoundCone(x, y, z, ux, uy, uz, 0.0, 0.0, 0.0, radius_a, 0.0)
        return RoundCone(x, y, z, ux, uy, uz, length, tan_slope, inverse, radius_a, radius_a - radius_b)


def random_cones(random: np.random.Generator, count: int, spread: float = 0.03) -> Cones:
    """Cones of the size of phalanges within `spread` [m]: most of them plain, some cylinders, some nearly spheres."""
    a = random.normal(0.0, spread, (count, 3))
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    length, radius = random.uniform(2e-3, 0.05, count), random.uniform(2e-3, 0.012, count)
    share = random.choice([0.0, 0.1, 0.5, 0.999, 1.0 - 1e-9], count, p=[0.2, 0.4, 0.2, 0.1, 0.1])
    length[random.random(count) < 0.1] = 0.0
    return Cones(a, a + length[:, None] * direction, radius, radius - share * np.minimum(length, radius))


def to_segment(x: FloatArray, p: FloatArray, q: FloatArray) -> FloatArray:
    """Distances [m] of points x, shape (..., 3), to the segments pq."""
    along = q - p
    square = (along * along).sum(axis=-1)
    share = ((x - p) * along).sum(axis=-1) / np.where(square > 0.0, square, 1.0)
    return np.asarray(np.linalg.norm(x - p - np.clip(share, 0.0, 1.0)[..., None] * along, axis=-1))


def from_triangles(corners: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """What gives distances [m] of points to triangles, shape (..., 3, 3)."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=-1)
    longest = ((corners - np.roll(corners, 1, axis=-2)) ** 2).sum(axis=-1).max(axis=-1)
    normal = normal / np.where(size > 0.0, size, 1.0)[..., None]
    sides = ((a, b), (b, c), (c, a))
    inward = [np.cross(normal, q - p) for p, q in sides]

    def distance(x: FloatArray) -> FloatArray:
        beside = [to_segment(x, p, q) for p, q in sides]
        inside = size > NEEDLE * longest
        for (p, _), across in zip(sides, inward):
            inside = inside & ((across * (x - p)).sum(axis=-1) > 0.0)
        above = np.abs(((x - a) * normal).sum(axis=-1))
        return np.where(inside, above, np.minimum(np.minimum(beside[0], beside[1]), beside[2]))

    return distance


def along_axes(cones: Cones, distance: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Least of distance(centre) - radius [m] over the axis of each of n cones; `distance` takes points (k, n, 3)."""

    def value(share: FloatArray) -> FloatArray:
        radius = cones.radius_a + share * (cones.radius_b - cones.radius_a)
        return np.asarray(distance(cones.a + share[..., None] * (cones.b - cones.a)) - radius)

    shares = np.linspace(0.0, 1.0, SAMPLES)
    sampled = value(np.repeat(shares[:, None], len(cones.a), axis=1))
    best, at = sampled.min(axis=0), sampled.argmin(axis=0)
    low, high = shares[np.maximum(at - 1, 0)], shares[np.minimum(at + 1, SAMPLES - 1)]
    for _ in range(SECTIONS):
        first, second = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        left, right = value(np.stack([first, second]))
        best = np.minimum(best, np.minimum(left, right))
        low, high = np.where(left > right, first, low), np.where(left > right, high, second)
    return np.asarray(best)


def to_cone(points: FloatArray, a: FloatArray, b: FloatArray, radius_a: float, radius_b: float) -> FloatArray:
    """Signed distances [m] of points, shape (n, 3), to one round cone."""
    parts = (a, b, np.array(radius_a), np.array(radius_b))
    cones = Cones(*(np.repeat(part[None], len(points), axis=0) for part in parts))
    return along_axes(cones, lambda x: np.asarray(np.linalg.norm(x - points, axis=-1)))


def box_distance(points: FloatArray, half: float) -> FloatArray:
    """Signed distance [m] of points, (N, 3), from a cube about the origin, in closed form."""
    beyond = np.abs(points) - half
    return np.asarray(np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(axis=1), 0.0))


def shift_of_boxes(*corners: FloatArray) -> float:
    """Least shift that takes two boxes apart [m], along the axes that separate boxes; negative their distance.

    Corners of each, (8, 3), are in the order of `box_mesh`.
    """
    edges = [[at[4] - at[0], at[2] - at[0], at[1] - at[0]] for at in corners]
    axes = [*edges[0], *edges[1], *(np.cross(a, b) for a in edges[0] for b in edges[1])]
    least = np.inf
    for axis in axes:
        if np.linalg.norm(axis) > 1e-12:
            here, there = (at @ axis / np.linalg.norm(axis) for at in corners)
            least = min(least, here.max() - there.min(), there.max() - here.min())
    return float(least)


def by_arctangents(triangles: FloatArray, points: FloatArray) -> FloatArray:
    """How often triangles go around points, by Van Oosterom and Strackee (1983), one arctangent a triangle."""
    a, b, c = (triangles[None, :, corner] - points[:, None] for corner in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=2) for side in (a, b, c))
    n = np.einsum("pti,pti->pt", a, np.cross(b, c))
    ab, bc, ca = (np.einsum("pti,pti->pt", first, second) for first, second in ((a, b), (b, c), (c, a)))
    return np.asarray(np.arctan2(n, la * lb * lc + ab * lc + bc * la + ca * lb).sum(axis=1) / (2.0 * np.pi))


@numba.njit(error_model="numpy")  # type: ignore[untyped-decorator]
def least_of_features(mesh: MeshFeatures, cone: RoundCone) -> float:
    """Least distance [m], by the kernels, to what belongs to a face: nothing else is ever listed."""
    least = np.inf
    for f in range(mesh.face.shape[0]):
        least = min(least, face_distance(mesh.face, f, cone))
        for k in range(3):
            e, v = mesh.face_edge[f, k], mesh.face_vertex[f, k]
            least = min(least, edge_distance(mesh.edge, e, cone)[0]) if e >= 0 else least
            least = min(least, vertex_distance(mesh.vertex, v, cone)[0]) if v >= 0 else least
    return least
