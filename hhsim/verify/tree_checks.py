"""Sphere trees without the builder's code: gap and protrusion of each level, and the claims of a file of its trees.

The spheres and triangles near a point come from scipy's k-d trees. Gap and protrusion are lower bounds from samples;
each search refines its worst samples on their triangle or sphere.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hhsim.arrays import FloatArray, IntArray
from hhsim.errors import MeshError
from hhsim.mesh.mesh import LARGEST_NUMBER, Mesh, require_usable_arrays
from hhsim.result.body import Body
from hhsim.result.reader import Result
from hhsim.trees.sphere_tree import SphereTree
from hhsim.verify.claim import NOT_CLAIMED, Claim, judged
from hhsim.verify.mesh_distance import TrueSurface

MESH_POINTS = 200_000
SPHERE_POINTS = 200_000
ON_SPHERE = 1e-12
"""Depth below which a point of a sphere is on it [m]: rounding."""
LEAST_EACH = 40
"""Minimum number of points on each sphere."""
NEIGHBOURS = 24
WORST = 200
CHILDREN = 40
ROUNDS = 5
FIRST_STEP = 0.2
SHRINK = 0.35
"""Search parameters: `CHILDREN` new points around each of the `WORST`, for `ROUNDS` rounds, each closer."""

SAMPLES = 10_000
"""Number of random points on the mesh, uniform by area, besides vertices and edge midpoints."""
COVER = 1e-9
"""Tolerance of a point outside all leaves [m]."""


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
        spheres = tree.spheres(level)
        slack = _least_slack(mesh, depth_in_spheres(*spheres), mesh_points, rng)
        protrusion, mean = _protrusion(surface, *spheres, sphere_points, rng)
        verdicts.append(Verdict(level, len(spheres[1]), max(0.0, -slack), slack, protrusion, mean))
    return tuple(verdicts)


def depth_in_spheres(center: FloatArray, radius: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Return a function from points (n, 3) to their greatest depth in spheres [m], (n,), exact below `ON_SPHERE`."""
    from scipy.spatial import cKDTree
    from scipy.spatial.distance import cdist

    nearest, count = cKDTree(center), min(NEIGHBOURS, len(radius))

    def depth(points: FloatArray) -> FloatArray:
        away, which = (np.reshape(found, (-1, count)) for found in nearest.query(points, k=count))
        best = (radius[which] - away).max(axis=1)
        # Of spheres of different sizes, the one that holds a point need not be among the nearest.
        unsure = np.flatnonzero(best < ON_SPHERE)
        for part in np.array_split(unsure, max(1, len(unsure) // 1000)):
            if part.size:
                best[part] = (radius - cdist(points[part], center)).max(axis=1)
        return np.asarray(best, np.float64)

    return depth


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


def _protrusion(
    surface: TrueSurface, center: FloatArray, radius: FloatArray, count: int, rng: np.random.Generator
) -> tuple[float, float]:
    """Maximum and mean distance of the spheres' union outside the mesh [m]."""
    area, depth_of = radius**2, depth_in_spheres(center, radius)
    each = np.maximum(LEAST_EACH, np.floor(count * area / area.sum())).astype(np.int64)
    owner = np.repeat(np.arange(len(each)), each)
    direction = rng.normal(size=(len(owner), 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]

    def height(owner: IntArray, direction: FloatArray) -> FloatArray:
        points = center[owner] + radius[owner, None] * direction
        found = np.full(len(owner), -np.inf)
        # What lies on its own sphere and in no other one is on the surface of the union.
        free = depth_of(points) < ON_SPHERE
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


def tree_claims(result: Result) -> list[Claim]:
    """Judge the sphere trees of all bodies."""
    return [judge(result) for judge in (_tree_encloses, cover)]


def _tree(body: Body) -> tuple[Any, ...]:
    return tuple(np.array(body.static[f"tree/{name}"]) for name in ("center", "radius", "level", "parent"))


def leaves(body: Body) -> tuple[FloatArray, FloatArray]:
    """Centres (L, 3) and radii (L,) of a body's leaf spheres [m], where its mesh is stored."""
    center, radius, level, _ = _tree(body)
    last = level == level.max(initial=0)
    return center[last], radius[last]


def _tree_encloses(result: Result) -> Claim:
    """No leaf sticks out of a sphere above it, which a descent of a tree relies on."""
    found = []
    for body in result.bodies.values():
        center, radius, level, parent = _tree(body)
        leaf = np.flatnonzero(level == level.max(initial=0))
        out = np.zeros(len(leaf))
        above = leaf.copy()
        # At most as many steps as there are spheres, whatever levels a damaged file states.
        for _ in range(min(int(level.max(initial=0)), len(radius) - 1)):
            above = np.clip(parent[above], 0, len(radius) - 1)
            away = np.linalg.norm(center[leaf] - center[above], axis=1)
            out = np.maximum(out, away + radius[leaf] - radius[above])
        found.append(out)
    says = "every leaf lies inside of the spheres above it"
    return judged("tree encloses", says, np.concatenate(found), 1e-9, "m", "rounding of a world frame")


def cover(result: Result) -> Claim:
    """Judge whether the leaves cover the meshes: their vertices, edge midpoints and random points."""
    surfaces = [(np.array(body.vertices), np.array(body.faces), *leaves(body)) for body in result.bodies.values()]
    claim = covered("cover", "the leaf spheres cover the surfaces of all bodies", *surfaces)
    if claim.note or covers(result):
        return claim
    note = "this tree was not built to cover the mesh, or the file does not say how it was"
    return replace(claim, verdict=NOT_CLAIMED, tick=None, note=note)


def covered(name: str, says: str, *surfaces: tuple[Any, ...]) -> Claim:
    """Judge whether spheres cover meshes: `surfaces` are the arguments of `outside_spheres` of each."""
    try:
        outside = np.concatenate([outside_spheres(*surface) for surface in surfaces])
        return judged(name, says, outside, COVER, "m", "less than any figure is stated to")
    except MeshError as error:
        return judged(name, says, [np.inf], COVER, "m", "exact", note=str(error))


def outside_spheres(vertices: FloatArray, faces: IntArray, center: FloatArray, radius: FloatArray) -> FloatArray:
    """Distance [m] of a mesh's vertices, edge midpoints and random points outside spheres, 0 inside, shape (N,).

    Raises:
        MeshError: Arrays that are no mesh.
    """
    require_usable_arrays(vertices, faces, "its mesh")
    # Squares of areas would overflow.
    if np.abs(vertices).max() > LARGEST_NUMBER:
        return np.array([np.inf])
    a, b, c = vertices[faces].transpose(1, 0, 2)
    rng = np.random.default_rng(0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    which = rng.choice(len(faces), SAMPLES, p=area / area.sum())
    s, t = rng.random((2, SAMPLES, 1))
    s, t = np.where(s + t > 1.0, 1.0 - s, s), np.where(s + t > 1.0, 1.0 - t, t)
    inner = a[which] + s * (b - a)[which] + t * (c - a)[which]
    points = np.concatenate([vertices[np.unique(faces)], 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a), inner])
    return np.asarray(np.maximum(-depth_in_spheres(center, radius)(points), 0.0))


def covers(result: Result) -> bool:
    """True if hhsim built the tree to cover the mesh."""
    options = result.scene.get("tree_options") or {}
    return result.scene.get("tree") is None and options.get("cover") == "outer"


def palm_claim(result: Result) -> Claim:
    """Judge the spheres of the palm."""
    static = result.static
    center, radius = static["hand/palm_center"], static["hand/palm_radius"]
    level = static["hand/palm_tree/level"]
    leaf = level == level.max(initial=0)
    says = "the palm's spheres are the leaves of its tree, and cover its mesh"
    of_tree = static["hand/palm_tree/center"][leaf], static["hand/palm_tree/radius"][leaf]
    if not (np.array_equal(of_tree[0], center) and np.array_equal(of_tree[1], radius)):
        return judged("palm", says, [np.inf], COVER, "m", "exact", note="its tree has other leaves")
    vertices, faces = static["hand/palm_mesh/vertices"], static["hand/palm_mesh/faces"]
    return covered("palm", says, tuple(map(np.array, (vertices, faces, center, radius))))
