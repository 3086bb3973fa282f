"""Gap and protrusion of a sphere tree, measured without the builder's code.

The spheres and triangles near a point come from scipy's k-d trees. The figures are lower bounds from samples; each
search refines its worst samples on their triangle or sphere.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hhsim.arrays import BoolArray, FloatArray, IntArray
from hhsim.mesh.mesh import Mesh
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.mesh_distance import TrueSurface

MESH_POINTS = 200_000
SPHERE_POINTS = 200_000
LEAST_EACH = 40
"""Minimum number of points on each sphere."""
NEIGHBOURS = 24
WORST = 200
CHILDREN = 40
ROUNDS = 5
FIRST_STEP = 0.2
SHRINK = 0.35
"""Search parameters: `CHILDREN` new points around each of the `WORST`, for `ROUNDS` rounds, each closer."""


@dataclass(frozen=True)
class Verdict:
    """Measures of one level of a tree."""

    level: int  # level, 0 for the root
    spheres: int  # number of its spheres
    gap: float  # maximum distance of a point of the mesh outside the spheres [m]; 0 for none
    slack: float  # minimum depth of a point of the mesh inside the spheres [m]; negative for a gap
    protrusion: float  # maximum distance of a point of the spheres' union outside the mesh [m]
    protrusion_mean: float  # mean over the part of the union's surface that is outside [m]


def referee(
    mesh: Mesh,
    tree: SphereTree,
    levels: Sequence[int] | None = None,
    *,
    mesh_points: int = MESH_POINTS,
    sphere_points: int = SPHERE_POINTS,
    seed: int = 0,
) -> tuple[Verdict, ...]:
    """Measure the levels of a tree.

    Args:
        mesh: Watertight and wound outward [m].
        tree: In the frame of the mesh.
        levels: None for all.
        mesh_points: Random points on the mesh, uniform by area; as many again on its edges, and all its vertices.
        sphere_points: Random points on the spheres of a level, uniform by area, at least `LEAST_EACH` on each.
        seed: Seed of the points.

    Raises:
        MeshError: The mesh is not watertight: there is no outside to measure in.
    """
    surface = TrueSurface(mesh)
    verdicts = []
    for level in range(tree.depth + 1) if levels is None else levels:
        rng = np.random.default_rng([seed, level])
        spheres = _Spheres(*tree.spheres(level))
        slack = _least_slack(mesh, depth_in_spheres(spheres.center, spheres.radius), mesh_points, rng)
        protrusion, mean = _protrusion(surface, spheres, sphere_points, rng)
        verdicts.append(Verdict(level, len(spheres.radius), max(0.0, -slack), slack, protrusion, mean))
    return tuple(verdicts)


def depth_in_spheres(center: FloatArray, radius: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return a function from points (n, 3) to their greatest depth in spheres [m], (n,), exact where it is negative."""
    from scipy.spatial import cKDTree
    from scipy.spatial.distance import cdist

    nearest, count = cKDTree(center), min(NEIGHBOURS, len(radius))

    def depth(points: FloatArray) -> FloatArray:
        away, which = (np.reshape(found, (-1, count)) for found in nearest.query(points, k=count))
        best = (radius[which] - away).max(axis=1)
        # Of spheres of different sizes, the one that holds a point need not be among the nearest.
        unsure = np.flatnonzero(best < 0.0)
        for part in np.array_split(unsure, max(1, len(unsure) // 1000)):
            if part.size:
                best[part] = (radius - cdist(points[part], center)).max(axis=1)
        return np.asarray(best, np.float64)

    return depth


class _Spheres:
    """Spheres of one level, with their overlaps."""

    def __init__(self, center: FloatArray, radius: FloatArray) -> None:
        from scipy.spatial import cKDTree

        self.center, self.radius = center, radius
        # Per sphere, the spheres that it meets.
        reach = cKDTree(center).query_ball_point(center, radius + radius.max())
        self.meets = []
        for i, near in enumerate(reach):
            others = np.array([j for j in near if j != i], np.int64)
            away = np.linalg.norm(center[others] - center[i], axis=1)
            self.meets.append(others[away < radius[others] + radius[i]])

    def exposed(self, points: FloatArray, owner: IntArray) -> BoolArray:
        """True for points on spheres that lie in no other sphere."""
        free = np.ones(len(points), np.bool_)
        order = np.argsort(owner, kind="stable")
        ends = np.searchsorted(owner[order], np.arange(len(self.radius) + 1))
        for i, others in enumerate(self.meets):
            mine = order[ends[i] : ends[i + 1]]
            if mine.size and others.size:
                away = points[mine][:, None] - self.center[others]
                inside = (away * away).sum(axis=2) < self.radius[others] ** 2
                free[mine] = ~inside.any(axis=1)
        return free


def _least_slack(
    mesh: Mesh, depth_of: Callable[[FloatArray], FloatArray], count: int, rng: np.random.Generator
) -> float:
    """Minimum depth of the mesh inside the spheres [m]."""
    triangles = mesh.triangles
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    face = rng.choice(len(triangles), size=count, p=area / area.sum())
    weight = rng.dirichlet(np.ones(3), size=count)
    # As many on the edges, by their length: where a cover is weakest, and where no random point of a face lies.
    length = np.linalg.norm(triangles[:, [1, 2, 0]] - triangles, axis=2).ravel()
    edge = rng.choice(length.size, size=count, p=length / length.sum())
    along = rng.random(count)
    on_edge = np.zeros((count, 3))
    on_edge[np.arange(count), edge % 3], on_edge[np.arange(count), (edge + 1) % 3] = 1.0 - along, along
    face = np.concatenate([face, edge // 3, np.repeat(np.arange(len(triangles)), 3)])
    weight = np.concatenate([weight, on_edge, np.tile(np.eye(3), (len(triangles), 1))])

    def depth(face: IntArray, weight: FloatArray) -> FloatArray:
        return -depth_of((weight[:, :, None] * triangles[face]).sum(axis=1))

    def moved(weight: FloatArray, step: float) -> FloatArray:
        there = np.maximum(weight + step * rng.normal(size=weight.shape), 0.0)
        # Clipped weights are points on edges and corners; where nothing is left, it stays where it was.
        there = np.where(there.any(axis=1, keepdims=True), there, weight)
        return np.asarray(there / there.sum(axis=1, keepdims=True), np.float64)

    return -_search(face, weight, depth(face, weight), depth, moved)


def _protrusion(surface: TrueSurface, spheres: _Spheres, count: int, rng: np.random.Generator) -> tuple[float, float]:
    """Maximum and mean distance of the spheres' union outside the mesh [m]."""
    area = spheres.radius**2
    each = np.maximum(LEAST_EACH, np.floor(count * area / area.sum())).astype(np.int64)
    owner = np.repeat(np.arange(len(each)), each)
    direction = rng.normal(size=(len(owner), 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]

    def height(owner: IntArray, direction: FloatArray) -> FloatArray:
        points = spheres.center[owner] + spheres.radius[owner, None] * direction
        found = np.full(len(owner), -np.inf)
        free = spheres.exposed(points, owner)
        found[free] = surface.signed_distance(points[free])
        return found

    first = height(owner, direction)
    outside = first > 0.0
    share = (area / each)[owner][outside]
    mean = float((first[outside] * share).sum() / share.sum()) if outside.any() else 0.0

    def moved(direction: FloatArray, step: float) -> FloatArray:
        there = direction + step * rng.normal(size=direction.shape)
        return np.asarray(there / np.linalg.norm(there, axis=1)[:, None], np.float64)

    return max(0.0, _search(owner, direction, first, height, moved)), mean


def _search(
    key: IntArray,
    place: FloatArray,
    found: FloatArray,
    value: Callable[[IntArray, FloatArray], FloatArray],
    moved: Callable[[FloatArray, float], FloatArray],
) -> float:
    """Maximum of `value`, which is `found` at some places, refined around the best of them."""
    step = FIRST_STEP
    best = np.argsort(-found, kind="stable")[:WORST]
    key, place, found = key[best], place[best], found[best]
    for _ in range(ROUNDS):
        wide_key = np.repeat(key, CHILDREN)
        there = moved(np.repeat(place, CHILDREN, axis=0), step)
        tried = value(wide_key, there).reshape(-1, CHILDREN)
        pick = tried.argmax(axis=1)
        top = tried[np.arange(len(key)), pick]
        better = top > found
        place = np.where(better[:, None], there.reshape(len(key), CHILDREN, -1)[np.arange(len(key)), pick], place)
        found = np.maximum(found, top)
        step *= SHRINK
    return float(found.max())
